// Corrupts mesh files and requests where a loader reads: values of the JSON, counts and offsets, compressed streams.
#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "fuzz/mesh/seeds.h"
#include "job/request.h"

namespace voxelpipe::fuzz {

using Random = std::mt19937_64;

struct Case {
  std::string seed;  // the name of the corrupted file
  std::vector<uint8_t> mesh;
  VoxelizeRequest request;
};

// The same for the same two numbers on every machine.
Case MakeCase(uint64_t seed, uint64_t number);

// Changes some bytes: flips, overwrites, cuts, repeats.
void SpoilBytes(std::vector<uint8_t>& bytes, Random& random);

// Changes some values, keys and elements of a document.
void SpoilJson(nlohmann::json& document, Random& random);

}  // namespace voxelpipe::fuzz
