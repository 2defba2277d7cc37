// The source of a primitive's vertex attributes: accessors, or a Draco stream.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "load/decode/draco.h"
#include "load/gltf/geometry/gltf_primitives.h"

namespace voxelpipe::gltf {

struct AttributeValues {
  int components = 0;
  std::vector<float> values;
  std::string origin;  // for messages: "accessor 3" or "Draco attribute 1"
};

// The same as vectors of V (Vec2f, Vec3f, Vec4f), empty if the attribute has another number of components.
template <typename V>
struct AttributeVectors {
  int components = 0;
  std::vector<V> values;
  std::string origin;
};

class AttributeSource {
 public:
  // In: attribute names -> accessors, the draco extension's names -> unique ids, and the decoded stream (none: plain).
  AttributeSource(const std::map<std::string, int>& accessors, std::map<std::string, uint32_t> draco_ids,
                  std::optional<DracoMesh> draco, const PrimitiveContext& context)
      : accessors_(accessors), draco_ids_(std::move(draco_ids)), draco_(std::move(draco)), context_(context) {
    for (size_t i = 0; draco_ && i < draco_->attributes.size(); ++i) {
      draco_places_.emplace(draco_->attributes[i].unique_id, i);
    }
  }

  // The values of an attribute; empty if the primitive has none of that name. Errors: INVALID_ARGUMENT naming the
  // accessor or the missing Draco attribute.
  absl::StatusOr<std::optional<AttributeValues>> Find(const std::string& name);

  template <typename V>
  absl::StatusOr<std::optional<AttributeVectors<V>>> FindVectors(const std::string& name);

  // POSITION in double, of a plain accessor of 64-bit floats; empty if it has no such.
  absl::StatusOr<std::vector<Vec3d>> DoublePositions() const;

  // Names of application-specific attributes, which begin with an underscore, ascending.
  std::vector<std::string> OwnNames() const;

  const std::optional<DracoMesh>& draco() const { return draco_; }

 private:
  // The stream's attribute for `name`, null if an accessor has it. Integers are divided by their maximum if the
  // accessor is normalized; without an accessor of integers, if the stream's attribute is.
  absl::StatusOr<const DracoAttribute*> InDraco(const std::string& name);
  bool IsNormalized(const std::string& name, const DracoAttribute& attribute) const;

  const std::map<std::string, int>& accessors_;
  std::map<std::string, uint32_t> draco_ids_;
  std::optional<DracoMesh> draco_;
  std::map<uint32_t, size_t> draco_places_;  // of the stream's attributes, by unique id; the first one of an id
  std::set<uint32_t> normalized_;            // unique ids of the stream's attributes that are already divided
  const PrimitiveContext& context_;
};

}  // namespace voxelpipe::gltf
