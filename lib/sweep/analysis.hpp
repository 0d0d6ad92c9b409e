// What the results of a sweep say: means with intervals, interquartile means with bootstrap bands, and how much of the
// spread each parameter explains.
#pragma once

#include <string>
#include <vector>

#include "math/wilson.hpp"

namespace giga {

double mean_of(const std::vector<double>& values);

/// The mean of the middle half of the values (Agarwal et al. 2021, arXiv 2108.13264): a quarter of them, rounded down,
/// is left out at each end, so that up to three values have their plain mean.
double interquartile_mean(std::vector<double> values);

/// 95 % interval of a mean by Student's t; of one value the value itself.
Interval mean_interval(const std::vector<double>& values);

/// 95 % interval of the interquartile mean: percentiles of 2,000 samples drawn with replacement. Deterministic.
Interval bootstrap_interval(const std::vector<double>& values);

/// How much of the spread of values their groups explain: the share of the variance that lies between groups, less what
/// chance would put there (epsilon squared, Kelley 1935); 0 to 1. NaN where there is only one group, or one value each.
double explained_share(const std::vector<size_t>& group, const std::vector<double>& values);

/// Groups of a setting's values over trials: of texts each text; of numbers with more than `most` different values,
/// `most` groups of about equal size, by their order.
std::vector<size_t> groups_of(const std::vector<std::string>& setting, size_t most = 4);

/// How the ranks of numbers and values go together, from -1 to 1 (Spearman 1904); NaN where one of them does not vary,
/// or the settings are no numbers.
double rank_correlation(const std::vector<std::string>& setting, const std::vector<double>& values);

}  // namespace giga
