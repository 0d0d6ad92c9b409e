// ConfigFile: the fixture of tests that read the config of a run from a file, and hold what is said of its mistakes.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "learn/run_config.hpp"

namespace giga::test {

class ConfigFile : public testing::Test {
 protected:
  // Not fs::remove_all: in programs with LibTorch it is that of libtorch.so, which crashes (torch 2.11).
  void TearDown() override {
    for (const char* name : {"run.yaml", "below.yaml"}) std::remove((prefix_ + name).c_str());
  }

  /// Writes what `base: BELOW` of a run's file stands for, in tests that begin with that.
  void write_below(const std::string& text) const { std::ofstream(prefix_ + "below.yaml") << text; }
  std::string base_below() const {
    return cat("base: ./", std::filesystem::path(prefix_ + "below.yaml").filename().string(), "\n");
  }

  LoadedRun load(const std::string& text, const std::vector<std::string>& overrides = {}) const {
    std::ofstream(prefix_ + "run.yaml") << text;
    return load_run_config(prefix_ + "run.yaml", overrides);
  }
  /// The message, without the folder and the number of the process.
  std::string error_of(const std::string& text, const std::vector<std::string>& overrides = {}) const {
    try {
      load(text, overrides);
    } catch (const InputError& e) {
      std::string message = e.what();
      for (size_t at; (at = message.find(prefix_)) != std::string::npos;) message.erase(at, prefix_.size());
      return message;
    }
    return "no error";
  }

  const std::string prefix_ = cat(testing::TempDir(), getpid(), "-");
};

}  // namespace giga::test
