// Sensors of a GPU: with a stand-in for NVML, without NVML, and on a GPU that is there.
#include "cuda/sensors.hpp"

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/error.hpp"
#include "cuda/runtime.hpp"

namespace giga::test {
namespace {

constexpr const char* kFake = GIGASTEP_FAKE_NVML;

TEST(Thermometer, ReadsTheDeviceOfThePciBusId) {
  EXPECT_EQ(GpuThermometer("0000:1A:00.0", kFake).read(), 41);
  EXPECT_EQ(GpuThermometer("0000:1B:00.0", kFake).read(), 52) << "a driver that has the old function alone";
}

TEST(Thermometer, IsNotKnownWithoutSensorDeviceOrLibrary) {
  EXPECT_TRUE(std::isnan(GpuThermometer("0000:1C:00.0", kFake).read())) << "no sensor";
  EXPECT_TRUE(std::isnan(GpuThermometer("0000:2A:00.0", kFake).read())) << "no such GPU";
  EXPECT_TRUE(std::isnan(GpuThermometer("0000:1A:00.0", "libno_such_library.so.1").read()));
  EXPECT_TRUE(std::isnan(GpuThermometer("0000:1A:00.0", "libc.so.6").read())) << "another library";
}

TEST(Thermometer, ShutsDownWhatItOpened) {
  void* fake = ::dlopen(kFake, RTLD_NOW);
  ASSERT_NE(fake, nullptr);
  const auto* users = static_cast<const int*>(::dlsym(fake, "fake_users"));
  {
    const GpuThermometer one("0000:1A:00.0", kFake), two("0000:1B:00.0", kFake), none("0000:2A:00.0", kFake);
    EXPECT_EQ(*users, 2) << "the one without a GPU is closed at once";
  }
  EXPECT_EQ(*users, 0);
  ::dlclose(fake);
}

TEST(Sensors, WithoutADeviceThereAreNone) {
  if (cuda_device_count() > 0) GTEST_SKIP() << "here is a GPU";
  EXPECT_THROW(GpuSensors(0), Error);
}

TEST(GpuSensorReading, IsThatOfTheDevice) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const GpuSensors sensors(0);
  const GpuReading before = sensors.read();
  EXPECT_EQ(before.memory_total, static_cast<int64_t>(cuda_device_info(0).memory_total));
  EXPECT_GT(before.memory_used, 0);
  EXPECT_LT(before.memory_used, before.memory_total);
  constexpr size_t kBytes = size_t{256} << 20;
  void* block = cuda_memory(0).allocate(kBytes);
  EXPECT_GE(sensors.read().memory_used, static_cast<int64_t>(kBytes)) << "what this process holds counts";
  cuda_memory(0).release(block);
  // A GPU that runs is between room temperature and the 100 or so degrees where it switches itself off.
  if (!std::isnan(before.temperature)) {
    EXPECT_GT(before.temperature, 5);
    EXPECT_LT(before.temperature, 110);
  }
}

}  // namespace
}  // namespace giga::test
