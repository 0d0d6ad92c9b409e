#include "python.hpp"

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <string>

#include "core/error.hpp"
#include "core/shell_word.hpp"
#include "io/files.hpp"
#include "support/source.hpp"

namespace giga::test {
namespace {

constexpr int kNotInstalled = 77, kNoPython = 127;  // the script's word, and the shell's

struct PythonOutcome {
  int code = -1;
  std::string out;  // and what it said of errors
};

PythonOutcome run_python(const std::string& arguments) {
  const std::string command = shell_word(python_with("sys")) + " -B " + arguments + " 2>&1";
  FILE* pipe = ::popen(command.c_str(), "r");
  GIGA_CHECK(pipe, command);
  PythonOutcome outcome;
  char block[4096];
  for (size_t n = 0; (n = std::fread(block, 1, sizeof block, pipe)) > 0;) outcome.out.append(block, n);
  const int status = ::pclose(pipe);
  outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return outcome;
}

}  // namespace

void write_tensor(const std::filesystem::path& file, const at::Tensor& tensor) {
  const at::Tensor values = tensor.detach().contiguous();
  write_file(file, {static_cast<const char*>(values.data_ptr()), values.nbytes()});
}

void expect_agreement(const TemporaryFolder& folder, size_t n) {
  const PythonOutcome outcome = run_python(shell_word(source_path("tests/export/compare.py")) + " " +
                                           shell_word(folder.path().string()) + " 1e-5");
  if (outcome.code == kNotInstalled || outcome.code == kNoPython)
    GTEST_SKIP() << "not all that reads the format is installed (scripts/bootstrap --dev): " << outcome.out;
  EXPECT_EQ(outcome.code, 0) << outcome.out;
  EXPECT_NE(outcome.out.find(cat(n, " policies agree")), std::string::npos) << outcome.out;
}

}  // namespace giga::test
