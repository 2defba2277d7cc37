// Typed reading of accessors; every range is checked in 64 bits before anything is allocated or read.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "load/gltf/document/gltf_buffers.h"
#include "load/gltf/document/gltf_document.h"

namespace voxelpipe::gltf {

class AccessorReader {
 public:
  // All must outlive this.
  AccessorReader(const Document& document, Buffers& buffers, Budget& budget)
      : document_(document), buffers_(buffers), budget_(budget) {}

  const JobContext& job() const { return budget_.job(); }
  const AccessorDecl& decl(uint32_t accessor) const { return document_.accessors[accessor]; }

  // All components as floats, element after element (count * components values; matrices without their padding).
  // Normalized integers are divided by their maximum, other integers are converted. Sparse values are applied; an
  // accessor without a buffer view is zeros.
  // Errors: INVALID_ARGUMENT naming the accessor, RESOURCE_EXHAUSTED past the limits.
  absl::StatusOr<std::vector<float>> Floats(uint32_t accessor) const;

  // The same as vectors: V is Vec2f, Vec3f or Vec4f, and the accessor's type VEC2, VEC3 or VEC4 (the caller has
  // checked).
  template <typename V>
  absl::StatusOr<std::vector<V>> Vectors(uint32_t accessor) const;

  // A VEC3 accessor of kDoubleComponents (the caller has checked).
  absl::StatusOr<std::vector<Vec3d>> Doubles(uint32_t accessor) const;

  // SCALAR (or, for joints, any) unsigned integers. INVALID_ARGUMENT for other component types.
  absl::StatusOr<std::vector<uint32_t>> Unsigned(uint32_t accessor) const;

  // The same in triples, for an accessor of SCALARs whose count is a multiple of three (the caller has checked).
  absl::StatusOr<std::vector<std::array<uint32_t, 3>>> Triples(uint32_t accessor) const;

 private:
  // Components of type T, one or several per element of `out`.
  template <typename T, typename E>
  absl::StatusOr<std::vector<E>> Read(uint32_t accessor) const;
  absl::Status CheckUnsigned(uint32_t accessor) const;

  const Document& document_;
  Buffers& buffers_;
  Budget& budget_;
};

}  // namespace voxelpipe::gltf
