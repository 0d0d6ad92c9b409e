// Which rank a process is, by the variables of torchrun and Slurm.
#include <gtest/gtest.h>

#include <map>

#include "core/error.hpp"
#include "ranks/place.hpp"

namespace giga {
namespace {

std::optional<RankPlace> place_of(const std::map<std::string, std::string>& variables) {
  return rank_place([&](const char* name) -> const char* {
    const auto found = variables.find(name);
    return found == variables.end() ? nullptr : found->second.c_str();
  });
}

std::string mistake_in(const std::map<std::string, std::string>& variables) {
  try {
    place_of(variables);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(RankPlace, IsReadFromTorchrun) {
  EXPECT_FALSE(place_of({}));
  EXPECT_FALSE(place_of({{"RANK", "0"}, {"WORLD_SIZE", "1"}, {"MASTER_PORT", "29500"}}));
  const auto place = place_of({{"RANK", "5"},
                               {"WORLD_SIZE", "8"},
                               {"LOCAL_RANK", "1"},
                               {"MASTER_ADDR", "node0"},
                               {"MASTER_PORT", "29500"},
                               {"TORCHELASTIC_USE_AGENT_STORE", "True"},
                               {"TORCHELASTIC_RESTART_COUNT", "2"}});
  ASSERT_TRUE(place);
  EXPECT_EQ(place->rank, 5);
  EXPECT_EQ(place->size, 8);
  EXPECT_EQ(place->local_rank, 1);
  EXPECT_EQ(place->gpu(1), 1) << "torchrun shows all processes all GPUs";
  EXPECT_EQ(place->host, "node0");
  EXPECT_EQ(place->port, 29500);
  EXPECT_TRUE(place->served);
  EXPECT_EQ(place->attempt, "2");
  EXPECT_FALSE(place_of({{"RANK", "0"}, {"WORLD_SIZE", "2"}, {"MASTER_PORT", "1"}})->served);
}

TEST(RankPlace, IsReadFromSlurmInAStepOnly) {
  std::map<std::string, std::string> variables = {{"SLURM_PROCID", "3"},
                                                  {"SLURM_NTASKS", "4"},
                                                  {"SLURM_LOCALID", "1"},
                                                  {"SLURM_JOB_NODELIST", "gpu[03-05,09],big1"},
                                                  {"SLURM_JOB_ID", "12345"}};
  EXPECT_FALSE(place_of(variables)) << "the script of sbatch is one process";
  variables["SLURM_STEP_ID"] = "2";
  const auto place = place_of(variables);
  ASSERT_TRUE(place);
  EXPECT_EQ(place->rank, 3);
  EXPECT_EQ(place->size, 4);
  EXPECT_EQ(place->local_rank, 1);
  EXPECT_EQ(place->gpu(4), 1);
  EXPECT_EQ(place->gpu(1), 0) << "srun --gpus-per-task 1: each process sees its own alone";
  EXPECT_EQ(place->host, "gpu03");
  EXPECT_EQ(place->port, 20000 + (2345 * 7 + 2) % 10000);  // 26417
  EXPECT_FALSE(place->served);
  variables["SLURM_STEP_NUM_TASKS"] = "1";  // srun --ntasks 1 in a job of four tasks
  EXPECT_FALSE(place_of(variables));
}

TEST(RankPlace, NamesWhatMakesNoSense) {
  EXPECT_EQ(mistake_in({{"RANK", "0"}}), "the variable WORLD_SIZE is not set, but others of several ranks are");
  EXPECT_EQ(mistake_in({{"RANK", "2"}, {"WORLD_SIZE", "2"}, {"MASTER_PORT", "1"}}),
            "the variable RANK is '2'; allowed: whole numbers from 0 to 1");
  EXPECT_EQ(mistake_in({{"RANK", "1"}, {"WORLD_SIZE", "two"}}),
            "the variable WORLD_SIZE is 'two'; allowed: whole numbers from 1 to 4096");
}

TEST(RankPlace, FindsTheFirstNode) {
  EXPECT_EQ(first_node("gpu03"), "gpu03");
  EXPECT_EQ(first_node("login,gpu03"), "login");
  EXPECT_EQ(first_node("gpu[03-05,09]"), "gpu03");
  EXPECT_EQ(first_node("gpu[7,9]"), "gpu7");
  EXPECT_EQ(first_node("gpu[7]"), "gpu7");
  EXPECT_EQ(first_node(""), "");
}

}  // namespace
}  // namespace giga
