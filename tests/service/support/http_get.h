// A GET by hand: what Prometheus and probes do.
#pragma once

#include <string>

namespace voxelpipe::testing {

// In: HOST:PORT on loopback and a path. Out: the whole answer, head and body; empty where nobody answers.
std::string HttpGet(const std::string& address, const std::string& path);

// The value of the sample `name` (labels and all, as it is printed) in Prometheus' text; -1 where there is none.
double SampleOf(const std::string& metrics, const std::string& name);

}  // namespace voxelpipe::testing
