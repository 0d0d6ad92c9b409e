// Small kernels in PTX: what instructions do, threads that part and meet again, and that a barrier which is missing is
// noticed.
#include "kernels/ptx_module.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <string>
#include <vector>

#include "core/error.hpp"

namespace giga::test {
namespace {

/// A kernel `try_it` with one parameter, a pointer in %rd1, the thread's number in %r1 and 4 x %r1 behind it in %rd2.
std::string kernel(const std::string& body) {
  return ".version 9.0\n.target sm_90\n.address_size 64\n.extern .shared .align 16 .b8 memory[];\n"
         ".entry try_it(\n  .param .u64 try_it_param_0\n)\n{\n"
         "  .reg .pred %p<9>;\n  .reg .b32 %r<40>;\n  .reg .f32 %f<20>;\n  .reg .b64 %rd<9>;\n"
         "  ld.param.u64 %rd1, [try_it_param_0];\n  mov.u32 %r1, %tid.x;\n  mul.wide.u32 %rd2, %r1, 4;\n"
         "  add.s64 %rd2, %rd1, %rd2;\n" +
         body + "\n  ret;\n}\n";
}

/// What the threads of a block leave in out [threads].
template <class T = int>
std::vector<T> run(const std::string& body, int threads = 32, ThreadOrder order = ThreadOrder::forward,
                   size_t shared_bytes = 4096) {
  std::vector<T> out(static_cast<size_t>(threads), T(-1));
  PtxModule(kernel(body)).launch({"try_it"}, {1}, threads, shared_bytes, out.data(), order);
  return out;
}

TEST(PtxModule, ComputesWithIntegers) {
  // -7 >> 1 = -4; 5 x -7 = -35; the high half of 2^20 x 2^20 is 2^8; (3 & 6) | (8 ^ 1) = 2 | 9 = 11.
  const auto out = run(
      "mov.u32 %r2, -7; shr.s32 %r3, %r2, 1; mul.lo.s32 %r4, %r2, 5; mov.u32 %r5, 1048576; mul.hi.u32 %r5, %r5, %r5;"
      "and.b32 %r6, 3, 6; xor.b32 %r7, 8, 1; or.b32 %r6, %r6, %r7;"
      "add.s32 %r8, %r3, %r4; add.s32 %r8, %r8, %r5; add.s32 %r8, %r8, %r6; add.s32 %r8, %r8, %r1;"
      "st.global.u32 [%rd2], %r8;");
  for (int k = 0; k < 32; ++k) EXPECT_EQ(out[static_cast<size_t>(k)], -4 - 35 + 256 + 11 + k);
}

// -1 as a number of 32 bits in a register of 64; shifts by 40, which leave nothing but the sign.
TEST(PtxModule, KnowsWidths) {
  const auto out = run(
      "mov.u32 %r2, -1; st.global.u32 [%rd2], %r2; ld.global.s32 %rd3, [%rd2]; shr.s64 %rd3, %rd3, 40;"
      "cvt.u32.u64 %r3, %rd3; shr.u32 %r4, %r2, 40; add.s32 %r3, %r3, %r4; shr.s32 %r5, %r2, 40; add.s32 %r3, %r3, %r5;"
      "st.global.u32 [%rd2], %r3;");
  EXPECT_EQ(out[0], -1 + 0 - 1);
}

TEST(PtxModule, ComputesWithNumbers) {
  // 1.5 + 0.25 x 8 = 3.5, less 2^0.5 and the half-precision numbers next to 1.0001 (1) and to 70,000 (65,504, held).
  const auto out = run<float>(
      "mov.f32 %f1, 0f3FC00000; fma.rn.ftz.f32 %f2, 0f3E800000, 0f41000000, %f1; ex2.approx.ftz.f32 %f3, 0f3F000000;"
      "sub.ftz.f32 %f2, %f2, %f3; cvt.rn.satfinite.f16x2.f32 %r2, 0f4788B800, 0f3F800347;"
      "{.reg .b16 low,high; mov.b32 {low,high}, %r2; cvt.f32.f16 %f4, low; cvt.f32.f16 %f5, high;}"
      "sub.f32 %f2, %f2, %f4; sub.f32 %f2, %f2, %f5; st.global.f32 [%rd2], %f2;");
  EXPECT_FLOAT_EQ(out[0], 3.5f - 1.41421356f - 1.0f - 65504.0f);
}

// Of a = 0x83828180 and b = 0x07060504, 0x1054 takes bytes 4 and 5 as the low half, 0 and 1 as the high one; 0xbc62
// takes bytes 2 and 6, the sign of byte 4 (none: 0) and of byte 3 (set: 0xff).
TEST(PtxModule, PermutesBytes) {
  const std::string bytes = "mov.u32 %r2, 0x83828180; mov.u32 %r3, 0x07060504; ";
  EXPECT_EQ(run(bytes + "prmt.b32 %r4, %r2, %r3, 0x1054; st.global.u32 [%rd2], %r4;")[0], 0x81800504u);
  EXPECT_EQ(run(bytes + "prmt.b32 %r4, %r2, %r3, 0xbc62; st.global.u32 [%rd2], %r4;")[0], 0xff000682u);
  EXPECT_THROW(run("prmt.b32.f4e %r4, %r2, %r3, %r1;"), Error);
}

// Lanes below 10 go another way, and the warp's shuffle finds them all again: each takes the number of lane + 1 or - 1.
TEST(PtxModule, LanesPartAndMeetAgain) {
  for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
    const auto out =
        run("setp.lt.s32 %p1, %r1, 10; mov.u32 %r2, %r1; @!%p1 bra $L_1; mul.lo.s32 %r2, %r1, 100;\n$L_1:\n"
            "shfl.sync.bfly.b32 %r3|%p2, %r2, 1, 31, -1; st.global.u32 [%rd2], %r3;",
            32, order);
    for (int k = 0; k < 32; ++k) EXPECT_EQ(out[static_cast<size_t>(k)], (k ^ 1) * ((k ^ 1) < 10 ? 100 : 1));
  }
}

// A product of 16 x 16 ones with 16 x 8 twos, onto 0.5: 16 x 1 x 2 + 0.5.
TEST(PtxModule, MultipliesTiles) {
  const auto out = run<float>(
      "mov.u32 %r2, 1006648320; mov.u32 %r3, 1073758208; mov.f32 %f1, 0f3F000000;"
      "mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 {%f2,%f3,%f4,%f5}, {%r2,%r2,%r2,%r2}, {%r3,%r3},"
      " {%f1,%f1,%f1,%f1}; add.f32 %f2, %f2, %f5; st.global.f32 [%rd2], %f2;");
  for (const float x : out) EXPECT_EQ(x, 65);
}

// Thread k writes k, as half precision's bits, to place k of a matrix of 8 x 8 (two numbers each). Read as it lies,
// lane l has numbers 2 l and 2 l + 1; transposed, number (row, column) is that of (column, row).
TEST(PtxModule, LoadsMatrices) {
  const std::string fill =
      "shl.b32 %r2, %r1, 2; mov.b64 %rd3, memory; cvt.u32.u64 %r3, %rd3; add.s32 %r2, %r2, %r3; shl.b32 %r4, %r1, 1;"
      "add.s32 %r5, %r4, 1; shl.b32 %r5, %r5, 16; or.b32 %r5, %r4, %r5; st.shared.u32 [%r2], %r5; bar.warp.sync -1;"
      "and.b32 %r6, %r1, 7; shl.b32 %r6, %r6, 4; add.s32 %r6, %r6, %r3;";
  const auto plain = run(fill + "ldmatrix.sync.aligned.m8n8.x1.shared.b16 {%r7}, [%r6]; st.global.u32 [%rd2], %r7;");
  const auto turned =
      run(fill + "ldmatrix.sync.aligned.m8n8.x1.trans.shared.b16 {%r7}, [%r6]; st.global.u32 [%rd2], %r7;");
  for (int l = 0; l < 32; ++l) {
    const int r = l / 4, c = l % 4 * 2;
    EXPECT_EQ(plain[static_cast<size_t>(l)], (8 * r + c) | (8 * r + c + 1) << 16);
    EXPECT_EQ(turned[static_cast<size_t>(l)], (8 * c + r) | (8 * (c + 1) + r) << 16);
  }
}

// Each thread reads what the last one wrote.
std::string turned_round(const std::string& barrier) {
  return "shl.b32 %r2, %r1, 2; st.shared.u32 [%r2], %r1; " + barrier +
         " sub.s32 %r3, 63, %r1; shl.b32 %r3, %r3, 2; ld.shared.u32 %r4, [%r3]; st.global.u32 [%rd2], %r4;";
}

TEST(PtxModule, ABarrierThatIsMissingIsNoticed) {
  for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
    const auto right = run(turned_round("bar.sync 0;"), 64, order);
    for (int k = 0; k < 64; ++k) EXPECT_EQ(right[static_cast<size_t>(k)], 63 - k);
  }
  EXPECT_NE(run(turned_round(""), 64, ThreadOrder::forward), run(turned_round(""), 64, ThreadOrder::backward));
  EXPECT_THROW(run("setp.lt.s32 %p1, %r1, 32; @%p1 bra $L_1; bar.sync 0;\n$L_1:\n", 64), Error);
  EXPECT_THROW(run("setp.lt.s32 %p1, %r1, 5; @%p1 bra $L_1; bar.warp.sync -1;\n$L_1:\n"), Error);
}

// Copies come at once, or when they are waited for: who does not wait finds what was there before in one of the two.
TEST(PtxModule, ACopyThatIsNotWaitedForIsNoticed) {
  const auto copy = [](const std::string& wait) {
    return "st.global.u32 [%rd2], %r1; shl.b32 %r2, %r1, 2; cp.async.ca.shared.global [%r2], [%rd2], 4, 4; " + wait +
           " ld.shared.u32 %r3, [%r2]; st.global.u32 [%rd2], %r3;";
  };
  for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward})
    EXPECT_EQ(run(copy("cp.async.wait_all;"), 32, order)[7], 7);
  EXPECT_NE(run(copy(""), 32, ThreadOrder::forward)[7], run(copy(""), 32, ThreadOrder::backward)[7]);
}

TEST(PtxModule, SaysWhatIsWrong) {
  const auto said = [](const auto& f) -> std::string {
    try {
      f();
    } catch (const Error& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_NE(said([] { run("sin.approx.f32 %f1, %f2;"); }).find("no PTX instruction that is known here: sin.approx.f32"),
            std::string::npos);
  for (const char* other : {"popc.b32 %r2, %r1;", "add.sat.f32 %f1, %f2, %f3;", "setp.lt.and.s32 %p1, %r1, %r2, %p2;",
                            "bar.red.popc.u32 %r1, 0, %p1;", "barrier.sync 0, 64;", "vote.sync.any.pred %p1, %p2, -1;"})
    EXPECT_NE(said([&] { run(other); }).find("no PTX instruction that is known here"), std::string::npos) << other;
  EXPECT_NE(said([] { run("mov.u32 %r2, %laneid;"); }).find("no register or symbol %laneid"), std::string::npos);
  EXPECT_NE(said([] { run("bar.sync 1;"); }).find("another barrier than 0"), std::string::npos);
  EXPECT_NE(said([] { run("ld.shared.u32 %r2, [%r1];"); }).find("address 1 of 4096 bytes of shared memory"),
            std::string::npos);
  EXPECT_NE(said([] { run("mov.u32 %r2, 4096; st.shared.u32 [%r2], %r1;"); }).find("address 4096 of 4096"),
            std::string::npos);
  EXPECT_NE(
      said([] { PtxModule(kernel("")).launch({"another"}, {1}, 32, 0, 0, ThreadOrder::forward); }).find("no kernel"),
      std::string::npos);
}

}  // namespace
}  // namespace giga::test
