// The meshes that the command line names: files, directories and patterns.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace voxelpipe::cli {

struct InputFile {
  std::string path;  // as typed, or found; "-" is standard input
  std::string name;  // of its outputs below an output directory, '/' between parts, without an extension
};

struct InputList {
  std::vector<InputFile> files;
  bool open_ended = false;  // a directory or pattern is among what was typed: there could be any number of files
};

// In: what was typed, each a file, "-", a directory or a pattern. Out: the files, those of a directory or pattern in
// the order of their bytes. A directory gives its meshes, by their extensions (MeshFormatOfName); with `recursive` also
// those of the directories below it. A pattern has `*`, `?` or `[...]`, which match within a name, or `**`, which
// matches any number of directories; one whose last part has no dot takes meshes only. A file of exactly this name is
// never a pattern. Hidden files and links to directories are passed over. Names: a file's stem; below a directory, or
// below the part of a pattern before its first wildcard, with the directories between. A file that does not exist is
// kept: to read it fails. Errors: INVALID_ARGUMENT for a directory or pattern without a mesh, one that cannot be
// listed, and for `recursive` without a directory.
absl::StatusOr<InputList> ExpandInputs(const std::vector<std::string>& typed, bool recursive);

}  // namespace voxelpipe::cli
