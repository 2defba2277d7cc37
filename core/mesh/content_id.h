// Content ids (TriangleMesh::content_id) of meshes that share arrays with another.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <string_view>

namespace voxelpipe {

// "ID/moved/N" has all arrays of "ID" but the positions, which are its own; N makes it another id than all others of
// this process.
inline constexpr std::string_view kMovedMark = "/moved/";

// A new id for a mesh whose positions alone differ from those of the mesh `id`; empty where that has none. Thread-safe.
inline std::string NewMovedId(const std::string& id) {
  static std::atomic<uint64_t> count{0};
  if (id.empty()) return {};
  return id.substr(0, id.find(kMovedMark)) + std::string(kMovedMark) + std::to_string(count++);
}

// What others may have of a mesh with this id.
struct SharedArrays {
  std::string id;          // that names them; empty: none
  bool positions = false;  // true if they are among them
};
inline SharedArrays SharedArraysOf(const std::string& content_id) {
  const size_t mark = content_id.find(kMovedMark);
  return {content_id.substr(0, mark), !content_id.empty() && mark == std::string::npos};
}

}  // namespace voxelpipe
