// Runs the tests of a program. Exit code 77 where all of them were skipped, which ctest shows as skipped.
#include <gtest/gtest.h>

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  const int code = RUN_ALL_TESTS();
  const testing::UnitTest& tests = *testing::UnitTest::GetInstance();
  const bool all_skipped = tests.successful_test_count() == 0 && tests.skipped_test_count() > 0;
  return code == 0 && all_skipped ? 77 : code;
}
