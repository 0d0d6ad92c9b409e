// ThreadPool, Buffer and the error type.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "core/error.hpp"
#include "core/memory.hpp"
#include "core/out_of_memory.hpp"
#include "core/thread_pool.hpp"

namespace giga {
namespace {

TEST(CoreThreadPool, EveryIndexOnceInContiguousRanges) {
  for (const int n_threads : {1, 2, 3, 7}) {
    ThreadPool pool(n_threads);
    EXPECT_EQ(pool.n_threads(), n_threads);
    for (const int64_t count : {int64_t{0}, int64_t{1}, int64_t{2}, int64_t{65}, int64_t{1000}}) {
      std::vector<int> visits(static_cast<size_t>(count), 0);
      std::vector<int64_t> begins(static_cast<size_t>(n_threads), -1), ends(static_cast<size_t>(n_threads), -1);
      pool.for_ranges(count, [&](int64_t begin, int64_t end, int thread) {
        begins[static_cast<size_t>(thread)] = begin;
        ends[static_cast<size_t>(thread)] = end;
        for (int64_t k = begin; k < end; ++k) ++visits[static_cast<size_t>(k)];
      });
      for (int64_t k = 0; k < count; ++k)
        EXPECT_EQ(visits[static_cast<size_t>(k)], 1) << n_threads << " threads, index " << k << " of " << count;
      for (int t = 0; t < n_threads; ++t) {
        const auto at = static_cast<size_t>(t);
        if (begins[at] < 0) continue;  // an empty range is not called
        EXPECT_EQ(begins[at], count * t / n_threads);
        EXPECT_EQ(ends[at], count * (t + 1) / n_threads);
      }
    }
  }
}

TEST(CoreThreadPool, ManyShortLoops) {
  ThreadPool pool(3);
  std::atomic<int64_t> sum{0};
  for (int round = 0; round < 2000; ++round)
    pool.for_ranges(5, [&](int64_t begin, int64_t end, int) {
      for (int64_t k = begin; k < end; ++k) sum += k;
    });
  EXPECT_EQ(sum, 2000 * (0 + 1 + 2 + 3 + 4));
}

TEST(CoreThreadPool, AnExceptionOfAnyThreadArrivesAndThePoolLivesOn) {
  ThreadPool pool(3);
  for (int64_t bad = 0; bad < 3; ++bad) {  // one index per thread; 0 is the caller's own
    std::atomic<int> finished{0};
    try {
      pool.for_ranges(3, [&](int64_t begin, int64_t, int) {
        if (begin == bad) throw std::runtime_error(cat("thread ", begin));
        ++finished;
      });
      FAIL() << "no exception from range " << bad;
    } catch (const std::runtime_error& e) {
      EXPECT_EQ(std::string(e.what()), cat("thread ", bad));
    }
    EXPECT_EQ(finished, 2) << "the other ranges run to their end";
    int64_t total = 0;
    pool.for_ranges(1, [&](int64_t begin, int64_t end, int) { total += end - begin; });
    EXPECT_EQ(total, 1) << "the loop after an exception";
  }
}

TEST(CoreThreadPool, TwoExceptionsGiveOne) {
  ThreadPool pool(2);
  EXPECT_THROW(pool.for_ranges(2, [](int64_t, int64_t, int) { throw Error("both"); }), Error);
}

/// Host memory that fills new blocks with 0xFF and counts what is alive.
class CountingMemory final : public Memory {
 public:
  Device device() const override { return {}; }
  void* allocate(size_t bytes) override {
    ++alive;
    void* p = host_memory().allocate(bytes);
    std::vector<uint8_t> poison(bytes, 0xFF);
    host_memory().from_host(p, poison.data(), bytes);
    return p;
  }
  void release(void* p) noexcept override {
    --alive;
    host_memory().release(p);
  }
  void clear(void* p, size_t bytes) override { host_memory().clear(p, bytes); }
  void to_host(void* host, const void* device, size_t bytes) override { host_memory().to_host(host, device, bytes); }
  void from_host(void* device, const void* host, size_t bytes) override {
    host_memory().from_host(device, host, bytes);
  }
  int alive = 0;
};

TEST(CoreBuffer, ZeroedAlignedAndReleased) {
  CountingMemory memory;
  {
    const Buffer<float> buffer(memory, size_t{7});
    EXPECT_EQ(memory.alive, 1);
    EXPECT_EQ(buffer.size(), 7u);
    EXPECT_EQ(buffer.bytes(), 28u);
    EXPECT_EQ(reinterpret_cast<uintptr_t>(buffer.data()) % 64, 0u);
    EXPECT_EQ(buffer.to_host(), std::vector<float>(7, 0.0f));
  }
  EXPECT_EQ(memory.alive, 0);
}

TEST(CoreBuffer, MovesHandOverTheBlock) {
  CountingMemory memory;
  {
    Buffer<int32_t> a(memory, std::vector<int32_t>{1, 2, 3});
    const int32_t* block = a.data();
    Buffer<int32_t> b(std::move(a));
    EXPECT_EQ(b.data(), block);
    EXPECT_EQ(b.to_host(), (std::vector<int32_t>{1, 2, 3}));
    EXPECT_EQ(memory.alive, 1);
    Buffer<int32_t> c(memory, std::vector<int32_t>{4});
    c = std::move(b);
    EXPECT_EQ(c.data(), block);
    EXPECT_EQ(c.size(), 3u);
    EXPECT_EQ(c.to_host(), (std::vector<int32_t>{1, 2, 3}));
    c.clear();
    EXPECT_EQ(c.to_host(), (std::vector<int32_t>{0, 0, 0}));
    c = Buffer<int32_t>();
    EXPECT_EQ(c.size(), 0u);
    EXPECT_EQ(c.data(), nullptr);
  }
  EXPECT_EQ(memory.alive, 0) << "blocks released exactly once";
}

TEST(CoreBuffer, EmptyNeedsNoMemory) {
  CountingMemory memory;
  Buffer<int32_t> none(memory, size_t{0});
  EXPECT_EQ(memory.alive, 0);
  EXPECT_EQ(none.data(), nullptr);
  EXPECT_TRUE(none.to_host().empty());
  none.from_host({});
  none.clear();
}

TEST(CoreError, CheckTellsTheValues) {
  try {
    const int n = 3;
    GIGA_CHECK(n == 4, "n is ", n);
    FAIL() << "did not throw";
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("n == 4: n is 3"), std::string::npos) << e.what();
    EXPECT_EQ(e.kind(), ErrorKind::internal);
  }
  EXPECT_EQ(InputError("x").kind(), ErrorKind::input);
  EXPECT_EQ((Device{Device::Kind::cuda, 2}.name()), "cuda:2");
  EXPECT_EQ(Device{}.name(), "cpu");
}

TEST(CoreError, MemoryThatRanOutIsToldByUsLibTorchAndTheDriver) {
  for (const char* message :
       {"CUDA out of memory. Tried to allocate 20.00 GiB. GPU 0 has a total capacity of 79.10 GiB of which 1.2 GiB is "
        "free.",
        "out of GPU memory: 8192 MiB wanted, 1203 of 81090 MiB free",
        "[enforce fail at alloc_cpu.cpp:124] err == 0. DefaultCPUAllocator: can't allocate memory: you tried to "
        "allocate 68719476736 bytes. Error code 12 (Cannot allocate memory)"})
    EXPECT_TRUE(tells_of_memory(message)) << message;
  EXPECT_FALSE(tells_of_memory("memory.yaml:1:1: unknown key"));
}

}  // namespace
}  // namespace giga
