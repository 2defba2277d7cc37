// The formats of mesh files.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/length_unit.h"

namespace voxelpipe {

enum class MeshFormat { kAuto, kGlb, kGltf, kDraco, kStl, kPly, kOff, kObj, k3mf };

// "glb", "gltf", "drc", "stl", "ply", "off", "obj", "3mf": the extension of such files; "auto" for kAuto.
std::string_view Name(MeshFormat format);
// The format by the extension of a file's name, in any case; empty if there is none that is known.
std::optional<MeshFormat> MeshFormatOfName(std::string_view file_name);

// A file whose first bytes have a statement, a keyword or a signature among them shows its format there.
inline constexpr uint64_t kSniffedBytes = 64 << 10;

// The format by the first kSniffedBytes of the content; empty if they show none. O(kSniffedBytes). `bytes` may be the
// beginning of a file of `file_bytes` (0: all of it).
std::optional<MeshFormat> SniffMeshFormat(std::span<const uint8_t> bytes, uint64_t file_bytes = 0);

// The format by all of the content, of which comments, blank lines or, in a ZIP archive, other entries may fill more
// than kSniffedBytes; kAuto if it is unknown. Errors: the job's, which is polled.
absl::StatusOr<MeshFormat> DetectMeshFormat(const JobContext& job, std::span<const uint8_t> file);

// What to tell a loader of a file: kAuto where DetectMeshFormat finds its format; else that of its name; kAuto if that
// is unknown too. Errors: the job's, which is polled.
absl::StatusOr<MeshFormat> FormatToTell(const JobContext& job, std::span<const uint8_t> file,
                                        std::string_view file_name);

// How the bytes of a mesh file are to be read.
struct MeshFileType {
  MeshFileType(MeshFormat of = MeshFormat::kAuto,  // NOLINT(google-explicit-constructor): most have no unit
               LengthUnit in = LengthUnit::kNone)
      : format(of), unit(in) {}

  MeshFormat format;  // kAuto: detected
  // Of the positions in a format without a unit (STL, PLY, OFF, OBJ, Draco), which are scaled to metres; kNone: taken
  // as they are.
  LengthUnit unit;
};

}  // namespace voxelpipe
