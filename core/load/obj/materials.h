// The materials of an OBJ file, by name.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/container/flat_hash_map.h"
#include "absl/status/statusor.h"
#include "load/base/load_budget.h"
#include "load/base/text_reader.h"
#include "mesh/scene/scene.h"

namespace voxelpipe::obj {

class Materials {
 public:
  // All must outlive this. Materials, textures and images go into `scene`.
  Materials(Scene& scene, LoadBudget& budget) : scene_(scene), budget_(budget) {}

  // The index of the material of this name; a new default one if there is none yet.
  absl::StatusOr<int32_t> Find(std::string_view name);

  // Reads the statement mtllib of a line: data: URIs of libraries. Other names give a warning: a loader opens no file.
  // Faults in a library give warnings.
  absl::Status ReadLibraries(std::string_view names, uint64_t line);

  // True if every library that the file names was read, and it names one.
  bool complete() const { return any_library_ && !any_missing_; }
  // True if a library has the material.
  bool defined(int32_t material) const { return defined_[size_t(material)]; }

 private:
  // The words of a line.
  Words WordsOf(std::string_view line) const { return Words(line, &budget_.job()); }
  absl::Status ReadLibrary(std::string_view text, const std::string& where);
  absl::Status Statement(std::string_view word, std::string_view line, const std::string& where);
  // The texture of a statement map_...: options, then a data: URI, or the name of one that came before.
  absl::Status ReadMap(std::string_view arguments, TextureRef& ref);
  absl::StatusOr<int32_t> ImageOf(std::string_view name, std::string& fault);

  Scene& scene_;
  LoadBudget& budget_;
  absl::flat_hash_map<std::string, int32_t> ids_;     // materials by name
  absl::flat_hash_map<std::string, int32_t> images_;  // by the name in their data: URI
  std::vector<bool> defined_;                         // by material
  int32_t current_ = -1;                              // the material that a library describes
  bool any_library_ = false, any_missing_ = false;
};

}  // namespace voxelpipe::obj
