// A minimal GET request, as from Prometheus and probes.
#pragma once

#include <string>

namespace voxelpipe::testing {

// In: HOST:PORT on loopback and a path. Out: the whole response, headers and body; empty if there is none.
std::string HttpGet(const std::string& address, const std::string& path);

// The value of the sample `name` (labels and all, as it is printed) in Prometheus' text; -1 if there is none.
double SampleOf(const std::string& metrics, const std::string& name);

}  // namespace voxelpipe::testing
