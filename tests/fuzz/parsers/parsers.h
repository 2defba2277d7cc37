// Every parser of untrusted input, behind one entry that takes any bytes.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace voxelpipe::fuzz {

struct Parser {
  const char* name;
  void (*run)(std::span<const uint8_t> bytes);
  std::vector<std::vector<uint8_t>> (*seeds)();  // valid inputs to start from
};

// gltf, glb, draco, image, meshopt, data_uri, manifest, options; in builds with the server, web.
std::span<const Parser> Parsers();
// Null where there is none of this name.
const Parser* FindParser(std::string_view name);

}  // namespace voxelpipe::fuzz
