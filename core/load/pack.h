// Client side only: reads a mesh file from this machine's disk and makes it self-contained for sending.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "base/warning.h"
#include "load/file_bytes.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/material.h"

namespace voxelpipe {

// Files that a glTF file names outside of its own directory, by ".." or through a symbolic link.
struct OutsideFiles {
  bool allowed = false;  // they are read
  // Which textures are wanted. An image outside that is not allowed is an error if it is one of those, else it stays a
  // URI, which the loader drops.
  TextureUse wanted{true, true, true};
};

// In: path of a .glb, .gltf or .drc. Out: bytes that LoadScene accepts without any file access. A .gltf (or .glb) that
// refers to sibling files gets them packed into one GLB; only files inside the file's own directory (after resolving
// symbolic links) are read unless `outside` allows others, percent-encoding is decoded, absolute paths and schemes are
// refused. A missing image stays a URI, which the loader warns of where a shader reads it (geometry does not need it);
// a missing buffer is an error.
// Errors: NOT_FOUND or INVALID_ARGUMENT, RESOURCE_EXHAUSTED past max_file_bytes, the system's with their reason. They
// name the URI at fault, but not `path`: the caller does. `warnings`, if given: what the packed bytes no longer show, a
// byte order mark and bytes behind a GLB's end.
absl::StatusOr<FileBytes> ReadAndPackMeshFile(const std::string& path, const LoadLimits& limits = {},
                                              WarningList* warnings = nullptr, const OutsideFiles& outside = {});

}  // namespace voxelpipe
