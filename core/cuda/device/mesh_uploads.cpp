// Counters of uploaded mesh bytes, one per device.
#include "cuda/device/mesh_uploads.h"

#include <array>
#include <atomic>

namespace voxelpipe::cuda {
namespace {

constexpr int kMaxDevices = 64;  // devices beyond share the last counter

std::atomic<uint64_t>& PlaceOf(int ordinal) {
  static std::array<std::atomic<uint64_t>, kMaxDevices> bytes{};
  return bytes[size_t(ordinal < kMaxDevices ? ordinal : kMaxDevices - 1)];
}

}  // namespace

void CountMeshUpload(int ordinal, uint64_t bytes) {
  PlaceOf(ordinal).fetch_add(bytes, std::memory_order_relaxed);
}

uint64_t MeshUploadedBytes(int ordinal) {
  return PlaceOf(ordinal).load(std::memory_order_relaxed);
}

}  // namespace voxelpipe::cuda
