// Checkpoints: what is written is read back; whatever is wrong with a file is told, and no part of it is believed.
#include "io/checkpoint.hpp"

#include <gtest/gtest.h>
#include <hdf5.h>

#include <limits>

#include "io/files.hpp"
#include "io/seal.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

Checkpoint sample() {
  Checkpoint c;
  c.gigastep_version = "0.1.0";
  c.scenario_name = "maps/größe.yaml";
  c.config_yaml = "seed: 3  # a comment\n";
  c.scenario_yaml = std::string(70'000, 'x');  // longer than an HDF5 attribute may be
  c.updates = 12;
  c.agent_steps = int64_t{1} << 40;
  c.seed = std::numeric_limits<uint64_t>::max();
  c.cursor = {12.5, 4321, uint64_t{1} << 33, 0.625, 8};
  c.arrays.push_back(make_array<float>("team_0/actor/weight", {1.5f, -0.0f, std::numeric_limits<float>::infinity()}));
  c.arrays.push_back(make_array<double>("team_0/actor/bias", {3.25}));
  c.arrays.push_back(make_array<int32_t>("a", {-1, 2, 3, 4, 5, 6}));
  c.arrays.back().shape = {2, 3};
  c.arrays.push_back(make_array<int64_t>("updates", {12}));
  c.arrays.back().shape = {};  // one number without extent
  c.arrays.push_back(make_array<uint8_t>("empty", {}));
  return c;
}

void expect_equal(const Checkpoint& a, const Checkpoint& b) {
  EXPECT_EQ(a.format_version, b.format_version);
  EXPECT_EQ(a.gigastep_version, b.gigastep_version);
  EXPECT_EQ(a.scenario_name, b.scenario_name);
  EXPECT_EQ(a.config_yaml, b.config_yaml);
  EXPECT_EQ(a.scenario_yaml, b.scenario_yaml);
  EXPECT_EQ(a.updates, b.updates);
  EXPECT_EQ(a.agent_steps, b.agent_steps);
  EXPECT_EQ(a.seed, b.seed);
  EXPECT_EQ(a.cursor.seconds, b.cursor.seconds);
  EXPECT_EQ(a.cursor.metrics_bytes, b.cursor.metrics_bytes);
  EXPECT_EQ(a.cursor.events_bytes, b.cursor.events_bytes);
  EXPECT_EQ(a.cursor.best_score, b.cursor.best_score);
  EXPECT_EQ(a.cursor.best_updates, b.cursor.best_updates);
  ASSERT_EQ(a.arrays.size(), b.arrays.size());
  for (size_t k = 0; k < a.arrays.size(); ++k) {
    EXPECT_EQ(a.arrays[k].name, b.arrays[k].name);
    EXPECT_EQ(a.arrays[k].type, b.arrays[k].type) << a.arrays[k].name;
    EXPECT_EQ(a.arrays[k].shape, b.arrays[k].shape) << a.arrays[k].name;
    EXPECT_EQ(a.arrays[k].bytes, b.arrays[k].bytes) << a.arrays[k].name;
  }
}

std::string decode_error(const std::string& bytes) {
  return input_error_of([&] { decode_checkpoint(bytes, "the_file.h5"); });
}

/// A file made with the HDF5 library alone; `fill` adds to it.
template <class F>
std::string hdf5_file(F&& fill) {
  const TemporaryFolder folder;
  const std::string path = (folder / "file.h5").string();
  const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  fill(file);
  H5Fclose(file);
  return read_file(path);
}

/// A copy of a checkpoint's bytes with one thing changed by the HDF5 library, and sealed again.
template <class F>
std::string altered(const Checkpoint& checkpoint, F&& change) {
  const TemporaryFolder folder;
  const std::string path = (folder / "file.h5").string();
  write_checkpoint(path, checkpoint);
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  change(file);
  H5Fclose(file);
  std::string bytes = read_file(path);
  seal(bytes, kCheckpointKind, kCheckpointFormat, "0.1.0");
  return bytes;
}

TEST(Checkpoint, RoundTrip) {
  const TemporaryFolder folder;
  const Checkpoint written = sample();
  write_checkpoint(folder / "c.h5", written);
  expect_equal(read_checkpoint(folder / "c.h5"), written);
  EXPECT_EQ(folder.entries(), 1) << "a temporary file was left";
}

// More than one node of a group's tree holds: 8 names a leaf, 32 leaves a node.
TEST(Checkpoint, HundredsOfArrays) {
  Checkpoint c = sample();
  for (int k = 0; k < 700; ++k) c.arrays.push_back(make_array<int32_t>(cat("many/", k, "/x"), {k}));
  for (int k = 0; k < 700; ++k) c.arrays.push_back(make_array<int32_t>(cat("flat/", k), {k}));
  expect_equal(c, decode_checkpoint(encode_checkpoint(c), "the_file.h5"));
}

TEST(Checkpoint, AnArrayIsNotReadTwice) {
  Checkpoint c = sample();
  for (NamedArray& a : c.arrays)
    if (a.name == "a") a = make_array<int32_t>("a", std::vector<int32_t>(50'000, 7));
  const std::string bytes = altered(c, [](hid_t file) {
    H5Ldelete(file, "arrays/team_0/actor/bias", H5P_DEFAULT);
    H5Lcreate_hard(file, "arrays/a", file, "arrays/team_0/actor/bias", H5P_DEFAULT, H5P_DEFAULT);
  });
  EXPECT_EQ(decode_error(bytes), "the_file.h5: is damaged: its HDF5 structure is broken");
}

TEST(Checkpoint, TheSameCheckpointGivesTheSameBytes) {
  EXPECT_EQ(encode_checkpoint(sample()), encode_checkpoint(sample()));
}

TEST(Checkpoint, MissingFileAndFolder) {
  const TemporaryFolder folder;
  const std::string missing = (folder / "none.h5").string();
  EXPECT_EQ(input_error_of([&] { read_checkpoint(missing); }), "there is no file " + missing);
  EXPECT_TRUE(contains(input_error_of([&] { read_checkpoint(folder.path()); }), {"is a folder, not a file"}));
}

TEST(Checkpoint, WhatIsNoCheckpoint) {
  EXPECT_EQ(decode_error(""), "the_file.h5: is empty");
  EXPECT_EQ(decode_error("PK\x03\x04 something else"), "the_file.h5: is not a gigastep checkpoint");
  const std::string foreign = hdf5_file([](hid_t) {});
  EXPECT_EQ(decode_error(foreign), "the_file.h5: is an HDF5 file but not a gigastep checkpoint");
}

TEST(Checkpoint, NewerFormat) {
  Checkpoint newer = sample();
  newer.format_version = kCheckpointFormat + 1;
  newer.gigastep_version = "9.7.0";
  EXPECT_TRUE(
      contains(decode_error(encode_checkpoint(newer)), {"has format version 4, newer than 3", "use gigastep 9.7.0"}));
}

TEST(Checkpoint, EveryTruncationIsNoticed) {
  const std::string bytes = encode_checkpoint(sample());
  for (size_t size = 1; size < bytes.size(); size += size < kSealBytes ? 1 : 97)
    ASSERT_TRUE(contains(decode_error(bytes.substr(0, size)), {"the_file.h5: is "})) << size;
  EXPECT_EQ(decode_error(bytes.substr(0, 1000)), cat("the_file.h5: is truncated: 1000 of ", bytes.size(), " bytes"));
  EXPECT_TRUE(contains(decode_error(bytes + "x"), {"is damaged"}));
}

TEST(Checkpoint, EveryFlippedBitIsNoticed) {
  Checkpoint small = sample();
  small.scenario_yaml = "description: short\n";
  const std::string bytes = encode_checkpoint(small);
  for (size_t at = 0; at < bytes.size(); ++at) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ (1 << (at % 8)));
    ASSERT_TRUE(contains(decode_error(damaged), {"the_file.h5: "})) << "byte " << at;
  }
}

TEST(Checkpoint, ADamagedArrayIsNamed) {
  const std::string bytes = altered(sample(), [](hid_t file) {
    const hid_t dataset = H5Dopen2(file, "arrays/team_0/actor/bias", H5P_DEFAULT);
    const double value = 3.5;
    H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value);
    H5Dclose(dataset);
  });
  EXPECT_EQ(decode_error(bytes), "the_file.h5: is damaged: the checksum of 'arrays/team_0/actor/bias' does not match");
}

TEST(Checkpoint, AMissingArrayIsNamed) {
  const std::string bytes =
      altered(sample(), [](hid_t file) { H5Ldelete(file, "arrays/team_0/actor/bias", H5P_DEFAULT); });
  EXPECT_EQ(decode_error(bytes), "the_file.h5: cannot read 'arrays/team_0/actor/bias'");
}

TEST(Checkpoint, OlderFormatIsRefused) {
  for (int format = 1; format < kCheckpointFormat; ++format) {
    Checkpoint older = sample();
    older.format_version = format;
    older.gigastep_version = "0.0.7";
    EXPECT_EQ(decode_error(encode_checkpoint(older)),
              cat("the_file.h5: has format version ", format,
                  ", older than 3, which this gigastep reads: use gigastep ", "0.0.7, which wrote it, or train again"));
  }
}

// Other programs read the file as it is, seal or not.
TEST(Checkpoint, IsPlainHdf5) {
  const TemporaryFolder folder;
  write_checkpoint(folder / "c.h5", sample());
  const hid_t file = H5Fopen((folder / "c.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  ASSERT_GE(file, 0);
  const hid_t dataset = H5Dopen2(file, "arrays/team_0/actor/bias", H5P_DEFAULT);
  double value = 0;
  EXPECT_GE(H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value), 0);
  EXPECT_EQ(value, 3.25);
  H5Dclose(dataset);
  H5Fclose(file);
}

// A data set that claims 2^60 numbers, in a file of a few kilobytes.
TEST(Checkpoint, HugeDimensionsAllocateNothing) {
  const std::string bytes = altered(sample(), [](hid_t file) {
    H5Ldelete(file, "arrays/a", H5P_DEFAULT);
    const hsize_t extent = hsize_t{1} << 60;
    const hid_t space = H5Screate_simple(1, &extent, nullptr);
    const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_alloc_time(properties, H5D_ALLOC_TIME_LATE);
    H5Dclose(H5Dcreate2(file, "arrays/a", H5T_STD_I32LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
    H5Pclose(properties);
    H5Sclose(space);
  });
  EXPECT_EQ(decode_error(bytes), "the_file.h5: 'arrays/a' is larger than the file");
}

TEST(Checkpoint, WrongTypeAndLayoutAreRefused) {
  for (const bool chunked : {false, true}) {
    const std::string bytes = altered(sample(), [&](hid_t file) {
      H5Ldelete(file, "arrays/a", H5P_DEFAULT);
      const hsize_t extent = 6;
      const hid_t space = H5Screate_simple(1, &extent, nullptr);
      const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
      if (chunked) H5Pset_chunk(properties, 1, &extent);
      const hid_t type = chunked ? H5T_STD_I32LE : H5T_STD_I16BE;
      H5Dclose(H5Dcreate2(file, "arrays/a", type, space, H5P_DEFAULT, properties, H5P_DEFAULT));
      H5Pclose(properties);
      H5Sclose(space);
    });
    EXPECT_TRUE(contains(decode_error(bytes), {chunked ? "'arrays/a' is stored in a way" : "'arrays/a' has a type"}));
  }
}

}  // namespace
}  // namespace giga::test
