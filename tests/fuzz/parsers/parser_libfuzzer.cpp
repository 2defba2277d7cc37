// libFuzzer's entry for the parser of this program: VOXELPIPE_PARSER. Without a corpus it begins with the parser's own
// seeds, which LLVMFuzzerCustomMutator draws where it is given nothing yet.
#include <algorithm>
#include <cstring>
#include <random>

#include "fuzz/parsers/parsers.h"

extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

namespace {

const voxelpipe::fuzz::Parser& TheParser() {
  static const voxelpipe::fuzz::Parser& parser = *voxelpipe::fuzz::FindParser(VOXELPIPE_PARSER);
  return parser;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  TheParser().run({data, size});
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size, unsigned int seed) {
  static const std::vector<std::vector<uint8_t>> seeds = TheParser().seeds();
  std::minstd_rand random(seed);
  constexpr unsigned kFromSeed = 64;  // one in so many
  if (size <= 1 || random() % kFromSeed == 0) {
    const std::vector<uint8_t>& from = seeds[random() % seeds.size()];
    size = std::min(from.size(), max_size);
    std::memcpy(data, from.data(), size);
  }
  return LLVMFuzzerMutate(data, size, max_size);
}
