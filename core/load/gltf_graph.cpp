#include "load/gltf_graph.h"

#include <fstream>  // its writer needs it even where reading files is off
#include <nlohmann/json.hpp>

// The implementation is compiled here and nowhere else: no Draco (ours checks every reference), no stb_image (images
// stay encoded), no file system.
#define TINYGLTF_IMPLEMENTATION
#include "load/gltf_model.h"

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "load/json_guard.h"

namespace voxelpipe::gltf {
namespace {

// No file exists, none can be read or written.
tinygltf::FsCallbacks NoFiles() {
  tinygltf::FsCallbacks callbacks{};
  callbacks.FileExists = [](const std::string&, void*) { return false; };
  callbacks.ExpandFilePath = [](const std::string&, void*) { return std::string(); };
  callbacks.ReadWholeFile = [](std::vector<unsigned char>*, std::string* error, const std::string&, void*) {
    if (error != nullptr) *error = "file access is off";
    return false;
  };
  callbacks.WriteWholeFile = [](std::string* error, const std::string&, const std::vector<unsigned char>&, void*) {
    if (error != nullptr) *error = "file access is off";
    return false;
  };
  return callbacks;
}

bool KeepEncoded(tinygltf::Image*, const int, std::string*, std::string*, int, int, const unsigned char*, int, void*) {
  return true;
}

}  // namespace

absl::StatusOr<tinygltf::Model> ParseGraph(const std::string& graph) {
  if (graph.size() > UINT32_MAX) return absl::ResourceExhaustedError("glTF: the document is too large");
  tinygltf::TinyGLTF parser;
  parser.SetFsCallbacks(NoFiles());
  parser.SetImageLoader(KeepEncoded, nullptr);
  tinygltf::Model model;
  std::string errors, warnings;
  bool parsed = false;
  try {
    parsed = parser.LoadASCIIFromString(&model, &errors, &warnings, graph.data(),
                                        static_cast<unsigned int>(graph.size()), "", tinygltf::REQUIRE_VERSION);
  } catch (const std::bad_alloc&) {
    throw;  // LoadScene answers for memory
  } catch (const std::exception& error) {
    errors = error.what();
  }
  if (!parsed) {
    const std::string line = errors.substr(0, errors.find('\n'));
    return absl::InvalidArgumentError(absl::StrCat("glTF: ", line.empty() ? "not understood" : Quoted(line)));
  }
  return model;
}

}  // namespace voxelpipe::gltf
