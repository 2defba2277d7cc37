// Writes ZIP archives in memory, for tests: deflated entries, or stored ones.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace voxelpipe::testing {

class ZipMaker {
 public:
  void Add(const std::string& name, const std::string& content, bool deflate = true);
  // The archive with its directory.
  std::string Bytes() const;

 private:
  struct Entry {
    std::string name;
    uint32_t crc = 0, packed = 0, size = 0, offset = 0;
    uint16_t method = 0;
  };
  std::string body_;
  std::vector<Entry> entries_;
};

// A 3MF package of this root model: "3D/3dmodel.model" and what names it.
ZipMaker Package3mf(const std::string& model);
// The root model with this in its resources and build.
std::string Model3mf(const std::string& resources, const std::string& build, const std::string& attributes = "");

}  // namespace voxelpipe::testing
