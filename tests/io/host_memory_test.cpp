// Free memory of a machine, and of containers on it, from folders that look like /proc and /sys.
#include "io/host_memory.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "temporary_folder.hpp"

namespace giga::test {
namespace {

class HostMemory : public testing::Test {
 protected:
  void write(const std::string& name, const std::string& text) {
    const std::filesystem::path file = root_ / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file) << text;
  }
  void SetUp() override {
    write("proc/meminfo", "MemTotal:       1000 kB\nMemFree:         10 kB\nMemAvailable:    600 kB\n");
    write("proc/self/cgroup", "1:name=systemd:/other\n0::/a/b\n");
  }
  MemorySpace space() const { return host_memory_space(root_.path().string()); }

  TemporaryFolder root_;
};

TEST_F(HostMemory, WithoutLimitsTheMachine) {
  EXPECT_EQ(space().total, 1'024'000);
  EXPECT_EQ(space().free, 614'400);
  write("sys/fs/cgroup/a/b/memory.max", "max\n");
  write("sys/fs/cgroup/a/b/memory.current", "5000\n");
  EXPECT_EQ(space().free, 614'400);
}

TEST_F(HostMemory, LimitOfTheGroupOrOfOneAbove) {
  write("sys/fs/cgroup/a/b/memory.max", "500000\n");
  write("sys/fs/cgroup/a/b/memory.current", "200000\n");
  EXPECT_EQ(space().total, 500'000);
  EXPECT_EQ(space().free, 300'000);
  // Caches of files can be dropped: 300,000 + 40,000 + 10,000.
  write("sys/fs/cgroup/a/b/memory.stat", "anon 150000\ninactive_file 40000\nactive_file 10000\n");
  EXPECT_EQ(space().free, 350'000);
  write("sys/fs/cgroup/a/memory.max", "400000\n");
  write("sys/fs/cgroup/a/memory.current", "390000\n");
  EXPECT_EQ(space().total, 400'000);
  EXPECT_EQ(space().free, 10'000);
  // A container sees its own group at the mount.
  write("proc/self/cgroup", "0::/\n");
  EXPECT_EQ(space().free, 614'400);
  write("sys/fs/cgroup/memory.max", "1000\n");
  write("sys/fs/cgroup/memory.current", "2000\n");
  EXPECT_EQ(space().free, 0);
}

TEST_F(HostMemory, ThisMachineAndNone) {
  const MemorySpace here = host_memory_space();
  EXPECT_GT(here.free, 0);
  EXPECT_LE(here.free, here.total);
  EXPECT_THROW(host_memory_space((root_ / "nothing").string()), Error);
}

}  // namespace
}  // namespace giga::test
