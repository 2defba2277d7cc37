// The list of jobs of `voxelpipe batch`: JSONL, one object a line.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "encode/preview/preview_view.h"
#include "job/request.h"
#include "options/mesh_type.h"
#include "options/together.h"
#include "request_text/request_options.h"

namespace voxelpipe::cli {

// Every n-th item, from the i-th on. The shards 0/n to n-1/n cover a manifest, and so do 1/n to n/n.
struct Shard {
  uint64_t index = 0, count = 1;
  bool Holds(size_t item) const { return item % count == index % count; }
};

// "i/n" with n at least 1 and i at most n. INVALID_ARGUMENT otherwise.
absl::StatusOr<Shard> ParseShard(const std::string& text);

// The request that items with the same options share.
struct BatchRequest {
  VoxelizeRequest request;
  // Requests with equal digests give the same bytes for the same mesh. It excludes options that do not change the
  // bytes: backend, threads and instruction set. 64 hexadecimal digits.
  std::string digest;
};

struct BatchItem {
  size_t line = 0;                              // in the manifest, from 1
  std::string id;                               // as given, otherwise the output's name without its extension
  std::string input;                            // path of the mesh file, or of the first of `meshes`
  Together meshes;                              // several on one grid; otherwise without paths
  MeshFileType type;                            // of that file
  std::string output;                           // of the result, relative to the output directory, '/' between parts
  std::string preview;                          // of the picture, relative in the same way; empty = none
  PreviewView view;                             // the camera of its pictures
  std::shared_ptr<const BatchRequest> request;  // shared by items with the same options
};

struct Manifest {
  std::vector<BatchItem> items;  // in order
};

struct ManifestDefaults {
  RequestOptions request;             // for options that an item does not give
  std::optional<std::string> format;  // a name of format_registry.h; absent: npy for dense results, npz for others
  std::optional<std::string> view;    // for items with pictures, as ParseView takes it; absent: its default
  MeshFlags mesh;
};

// In: the path of a manifest. Each line is an object, or blank. Its keys, all optional but `input` or `meshes`:
//   input    mesh file; a relative path is searched in the manifest's directory, then in the working directory
//   meshes   several on one grid instead, as ParseTogether takes them
//   id       a name, unique ("name" means the same)
//   output   the result's file below the output directory; default: the id, otherwise the input's stem, with the
//            extension of the format
//   format   npy, npz, ...: a name of core/encode/format_registry.h
//   preview  file of a picture below the output directory
//   view     the camera of the item's pictures, as ParseView takes it
//   unit, input_format    of the mesh file, as `voxelpipe voxelize` takes them
// and any option of `voxelpipe voxelize` about the grid, the voxels and the execution, without its dashes ("voxel_size"
// or "voxel-size"): numbers, texts, or lists of them; "target" is a text or a list. A grid of an item replaces that of
// the defaults. The file of a "grid_like" is searched like an input; digests hold its grid, not its name. Errors:
// INVALID_ARGUMENT "FILE:LINE: what is wrong" for the first line at fault: no JSON, an unknown key, a wrong option, a
// view without a picture, an extension that cannot hold the result, a file outside the output directory, or two items
// with one id or one file. NOT_FOUND and the system's errors if the manifest cannot be read.
absl::StatusOr<Manifest> ReadManifest(const std::string& path, const ManifestDefaults& defaults);

}  // namespace voxelpipe::cli
