// Spoils mesh files and requests where a loader looks: in the JSON's values, in the counts and offsets, in the
// compressed streams.
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
  std::string seed;  // the name of the file that was spoilt
  std::vector<uint8_t> mesh;
  VoxelizeRequest request;
};

// The same for the same two numbers, whatever the machine.
Case MakeCase(uint64_t seed, uint64_t number);

// Changes some bytes: flips, overwrites, cuts, repeats.
void SpoilBytes(std::vector<uint8_t>& bytes, Random& random);

// Changes some values, keys and elements of a document.
void SpoilJson(nlohmann::json& document, Random& random);

}  // namespace voxelpipe::fuzz
