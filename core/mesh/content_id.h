// Content ids (TriangleMesh::content_id) of meshes that share arrays with another.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <string_view>

namespace voxelpipe {

// "ID/moved/N" shares all arrays of "ID" except the positions, which are its own; N makes the id unique in this
// process.
inline constexpr std::string_view kMovedMark = "/moved/";

// A new id for a mesh that differs from the mesh `id` in its positions alone; empty if `id` is. Thread-safe.
inline std::string NewMovedId(const std::string& id) {
  static std::atomic<uint64_t> count{0};
  if (id.empty()) return {};
  return id.substr(0, id.find(kMovedMark)) + std::string(kMovedMark) + std::to_string(count++);
}

// The arrays that a mesh with this id shares with others.
struct SharedArrays {
  std::string id;          // the id of the shared arrays; empty: none
  bool positions = false;  // true if the positions are shared
};
inline SharedArrays SharedArraysOf(const std::string& content_id) {
  const size_t mark = content_id.find(kMovedMark);
  return {content_id.substr(0, mark), !content_id.empty() && mark == std::string::npos};
}

}  // namespace voxelpipe
