// Client side only: reads a mesh file from the local disk and makes it self-contained for sending.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/warning.h"
#include "load/decode/mesh_format.h"
#include "load/file_bytes.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/material.h"

namespace voxelpipe {

// Policy for files outside the directory of the glTF file, named by ".." or through a symbolic link.
struct OutsideFiles {
  bool allowed = false;  // true: they are read
  // The textures that shaders read. A disallowed image outside is an error if one of these uses it; otherwise it stays
  // a URI, which the loader drops.
  TextureUse wanted{true, true, true};
};

// A mesh file that needs no other one.
struct PackedMesh {
  FileBytes bytes;
  MeshFormat format = MeshFormat::kAuto;  // FormatToTell: LoadScene and calls need it with the bytes
};

// In: path of a mesh file of any format. Out: bytes that LoadScene accepts without any file access. A .gltf (or .glb)
// that refers to sibling files is packed with them into one GLB, an .obj gets them as data: URIs (pack_obj.h); only
// files inside the file's own directory (after resolving symbolic links) are read unless `outside` allows others,
// percent-encoding is decoded, absolute paths and schemes are refused. A missing image stays a URI, of which the loader
// warns if a shader reads it (geometry does not need it); a missing buffer is an error. Errors: NOT_FOUND or
// INVALID_ARGUMENT, RESOURCE_EXHAUSTED past max_file_bytes, the system's with their reason. They begin with `path`, and
// name the URI at fault. `warnings`, if given, receives faults that the packed bytes no longer show: a byte order mark
// and bytes after a GLB's end.
absl::StatusOr<PackedMesh> ReadAndPackMeshFile(const std::string& path, const LoadLimits& limits = {},
                                               WarningList* warnings = nullptr, const OutsideFiles& outside = {});

// The same for a mesh in memory, in any of the formats, whose errors name the URI alone; files that it names are
// searched in `directory` (empty: the working directory). A file is read once however often it is named. What is read
// and written is charged to MemoryOf(job) meanwhile, and the job is polled: its errors too. `format` kAuto: detected.
absl::StatusOr<FileBytes> PackMesh(const JobContext& job, FileBytes bytes, const std::filesystem::path& directory,
                                   const LoadLimits& limits = {}, WarningList* warnings = nullptr,
                                   const OutsideFiles& outside = {}, MeshFormat format = MeshFormat::kAuto);

}  // namespace voxelpipe
