// One job of `voxelpipe batch`, from its line in a manifest.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "encode/preview/preview_view.h"
#include "job/request.h"
#include "options/mesh_type.h"
#include "options/together.h"
#include "request_text/request_options.h"

namespace voxelpipe::cli {

// The request that items with the same options share.
struct BatchRequest {
  VoxelizeRequest request;
  // Requests with equal digests give the same bytes for the same mesh. It excludes options that do not change the
  // bytes: backend, threads and instruction set. 64 hexadecimal digits.
  std::string digest;
};

struct BatchItem {
  size_t line = 0;                              // in the manifest, from 1
  size_t number = 0;                            // among the items of the manifest, from 0
  std::string id;                               // as given, otherwise the output's name without its extension
  std::string input;                            // path of the mesh file, or of the first of `meshes`
  Together meshes;                              // several on one grid; otherwise without paths
  MeshFileType type;                            // of that file
  std::string output;                           // of the result, relative to the output directory, '/' between parts
  std::string preview;                          // of the picture, relative in the same way; empty = none
  PreviewView view;                             // the camera of its pictures
  std::shared_ptr<const BatchRequest> request;  // shared by items with the same options
};

struct ManifestDefaults {
  RequestOptions request;             // for options that an item does not give
  std::optional<std::string> format;  // a name of format_registry.h; absent: npy for dense results, npz for others
  std::optional<std::string> view;    // for items with pictures, as ParseView takes it; absent: its default
  MeshFlags mesh;
};

// Makes items of the lines of a manifest, which are JSON objects. Keys, all optional but `input` or `meshes`:
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
// the defaults. The file of a "grid_like" is searched like an input; digests hold its grid, not its name.
class ItemParser {
 public:
  // `directory` is that of the manifest. `defaults` must outlive the object.
  ItemParser(const std::string& directory, const ManifestDefaults& defaults);
  ItemParser(const ItemParser&) = delete;
  ItemParser& operator=(const ItemParser&) = delete;
  ~ItemParser();

  // Out: the item, with number 0. INVALID_ARGUMENT: no JSON, an unknown key, a wrong option, a view without a picture,
  // an extension that cannot hold the result, a file outside the output directory, or an id or a file that an earlier
  // line has. Of each id and file, the object keeps a fingerprint of 16 bytes.
  absl::StatusOr<BatchItem> Parse(size_t line, std::string_view text);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace voxelpipe::cli
