// Source: glTF 2.0 specification, sections 3.6 (buffers and buffer views), 4.4 (GLB).
#include "load/pack.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "base/memory_budget.h"
#include "load/base/charged_growth.h"
#include "load/base/data_uri.h"
#include "load/decode/glb_container.h"
#include "load/gltf/document/gltf_json.h"
#include "load/gltf/document/json_guard.h"
#include "load/loader.h"
#include "load/local_file.h"
#include "load/pack_obj.h"

namespace voxelpipe {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

// The destination of a buffer of the file.
struct BufferPlace {
  bool merged = false;  // into the BIN chunk
  uint64_t base = 0;    // its first byte there
  uint64_t length = 0;  // its declared bytes
  uint64_t new_index = 0;
};

// The JSON of a GLB or glTF file and the GLB's BIN chunk.
struct Source {
  Json json;            // without members that the loader does not read
  MemoryCharge memory;  // of the JSON
  std::optional<std::span<const uint8_t>> binary;
  WarningList warnings;  // the warnings of the loader for the original file
};

bool IsObjectArray(const Json& json, const char* key) {
  const auto it = json.find(key);
  return it != json.end() && it->is_array() &&
         std::all_of(it->begin(), it->end(), [](const Json& e) { return e.is_object(); });
}

std::optional<uint64_t> Unsigned(const Json& object, const char* key, uint64_t absent) {
  const auto it = object.find(key);
  if (it == object.end()) return absent;
  if (!it->is_number_unsigned()) return std::nullopt;
  return it->get<uint64_t>();
}

// The URI of a buffer or image that names a file; empty if there is none.
std::optional<std::string> FileUri(const Json& object) {
  const auto it = object.find("uri");
  if (it == object.end() || !it->is_string()) return std::nullopt;
  const auto& uri = it->get_ref<const std::string&>();
  if (IsDataUri(uri)) return std::nullopt;
  return uri;
}

bool AnyFileUri(const Json& json) {
  for (const char* key : {"buffers", "images"}) {
    if (!IsObjectArray(json, key)) continue;
    for (const Json& object : json[key]) {
      if (FileUri(object)) return true;
    }
  }
  return false;
}

// Empty if the bytes are not a glTF file that can be packed: the loader then reports what is wrong.
std::optional<Source> Parse(const JobContext& job, std::span<const uint8_t> bytes, MeshFormat format,
                            const LoadLimits& limits) {
  Source source;
  source.memory = MemoryCharge(&MemoryOf(job));
  std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (format == MeshFormat::kGlb) {
    const auto chunks = SplitGlb(job, bytes);
    if (!chunks.ok()) return std::nullopt;
    text = chunks->json;
    source.binary = chunks->binary;
    AddLeftOverBytes(*chunks, source.warnings);
  } else if (format != MeshFormat::kGltf) {
    return std::nullopt;
  }
  text = WithoutByteOrderMark(text, source.warnings);
  if (!GuardJson(job, text, limits).ok()) return std::nullopt;
  auto json = gltf::ParseJson(job, text, limits, source.memory);
  if (!json.ok() || !json->is_object() || !AnyFileUri(*json)) return std::nullopt;
  source.json = *std::move(json);
  return source;
}

class Packer {
 public:
  Packer(const JobContext& job, Source source, fs::path directory, const LoadLimits& limits,
         const OutsideFiles& outside)
      : job_(job),
        json_(std::move(source.json)),
        memory_(std::move(source.memory)),
        binary_(source.binary),
        directory_(std::move(directory)),
        limits_(limits),
        outside_(outside) {}

  absl::StatusOr<FileBytes> Pack() {
    if (absl::Status s = MergeBuffers(); !s.ok()) return s;
    if (absl::Status s = MoveViews(); !s.ok()) return s;
    if (absl::Status s = EmbedImages(); !s.ok()) return s;
    if (bin_.empty()) bin_.resize(4);  // buffer 0 is the chunk, so there must be one
    json_["buffers"][0]["byteLength"] = bin_.size();
    return WriteGlb();
  }

 private:
  // Fills up to the next multiple of 4 bytes.
  absl::Status Align() {
    const size_t aligned = (bin_.size() + 3) / 4 * 4;
    if (absl::Status s = MakeRoom(aligned - bin_.size()); !s.ok()) return s;
    bin_.resize(aligned);
    return absl::OkStatus();
  }

  absl::Status Append(std::span<const uint8_t> bytes, uint64_t& base) {
    if (absl::Status s = Align(); !s.ok()) return s;
    base = bin_.size();
    if (bytes.size() > limits_.max_file_bytes ||
        base + bytes.size() > std::min<uint64_t>(limits_.max_file_bytes, UINT32_MAX)) {
      return absl::ResourceExhaustedError(
          absl::StrCat("the packed mesh would be larger than ", limits_.max_file_bytes, " bytes"));
    }
    if (absl::Status s = MakeRoom(bytes.size()); !s.ok()) return s;
    bin_.insert(bin_.end(), bytes.begin(), bytes.end());
    return absl::OkStatus();
  }

  absl::Status MakeRoom(uint64_t more) { return MakeChargedRoom(memory_, bin_, more, "the packed mesh:"); }

  // The file of a URI. Errors: those of the URI; INVALID_ARGUMENT for a file outside, unless those are allowed.
  absl::StatusOr<SiblingFile> Resolve(const std::string& uri) {
    const auto known = siblings_.find(uri);
    if (known != siblings_.end()) return known->second;
    absl::StatusOr<SiblingFile> sibling = ResolveSibling(directory_, uri);
    constexpr uint64_t kBytesAPlace = 256;  // in the table
    const uint64_t bytes = kBytesAPlace + 2 * uri.size() + (sibling.ok() ? 2 * sibling->path.native().size() : 0);
    if (absl::Status s = memory_.Grow(bytes, "names of files:"); !s.ok()) return s;
    siblings_.emplace(uri, sibling);
    return sibling;
  }

  // Puts the first bytes of a buffer's file into the BIN chunk, if they are not there yet.
  absl::Status MergeFile(size_t index, const Json& buffer, const std::string& uri, BufferPlace& place) {
    const absl::StatusOr<SiblingFile> sibling = Resolve(uri);
    if (!sibling.ok()) return At("buffer", index, sibling.status());
    if (absl::Status s = CheckPlace("buffer", index, uri, *sibling); !s.ok()) return s;
    const auto known = merged_.find(sibling->path);
    if (known != merged_.end()) {
      const absl::StatusOr<uint64_t> length = LengthOf(index, buffer, known->second.file_bytes);
      if (!length.ok()) return length.status();
      if (*length <= known->second.length) {
        place = {true, known->second.base, *length, 0};
        return absl::OkStatus();
      }
    }
    MemoryCharge charge(&MemoryOf(job_));
    const auto file = ReadSibling(sibling->path, limits_.max_file_bytes, charge);
    if (!file.ok()) return At("buffer", index, Named(uri, file.status()));
    const absl::StatusOr<uint64_t> length = LengthOf(index, buffer, file->size());
    if (!length.ok()) return length.status();
    // A second, longer part of a file brings all of it: there is no third.
    const std::span<const uint8_t> bytes = known == merged_.end() ? std::span(*file).first(*length) : std::span(*file);
    if (absl::Status s = Append(bytes, place.base); !s.ok()) return s;
    merged_[sibling->path] = {place.base, bytes.size(), file->size()};
    place = {true, place.base, *length, 0};
    return absl::OkStatus();
  }

  // The declared bytes of a buffer whose data has so many.
  static absl::StatusOr<uint64_t> LengthOf(size_t index, const Json& buffer, uint64_t data_bytes) {
    const auto length = Unsigned(buffer, "byteLength", data_bytes);
    if (!length) return At("buffer", index, absl::InvalidArgumentError("byteLength is not a whole number"));
    if (*length <= data_bytes) return *length;
    return At(
        "buffer", index,
        absl::InvalidArgumentError(absl::StrCat("byteLength ", *length, ", but its data has ", data_bytes, " bytes")));
  }

  // Files and the BIN chunk become buffer 0; buffers with data: URIs or without data keep their own.
  absl::Status MergeBuffers() {
    Json kept = Json::array({Json{{"byteLength", 0}}});
    Json buffers = IsObjectArray(json_, "buffers") ? std::move(json_["buffers"]) : Json::array();
    for (size_t i = 0; i < buffers.size(); ++i) {
      if (absl::Status over = job_.Check(); !over.ok()) return over;
      BufferPlace place;
      if (const auto uri = FileUri(buffers[i])) {
        if (absl::Status s = MergeFile(i, buffers[i], *uri, place); !s.ok()) return s;
      } else if (i == 0 && binary_ && !buffers[i].contains("uri")) {
        const absl::StatusOr<uint64_t> length = LengthOf(i, buffers[i], binary_->size());
        if (!length.ok()) return length.status();
        place = {true, 0, *length, 0};
        if (absl::Status s = Append(binary_->first(*length), place.base); !s.ok()) return s;
      } else {
        place.new_index = kept.size();
        kept.push_back(std::move(buffers[i]));
      }
      places_.push_back(place);
    }
    json_["buffers"] = std::move(kept);
    return absl::OkStatus();
  }

  static absl::Status At(const char* what, size_t index, const absl::Status& why) {
    return absl::Status(why.code(), absl::StrCat(what, " ", index, ": ", why.message()));
  }
  static absl::Status Named(const std::string& uri, const absl::Status& why) {
    return absl::Status(why.code(), absl::StrCat(UriName(uri), ": ", why.message()));
  }

  // INVALID_ARGUMENT for a file outside, unless those are allowed.
  absl::Status CheckPlace(const char* what, size_t index, const std::string& uri, const SiblingFile& sibling) const {
    if (outside_.allowed || sibling.outside.empty()) return absl::OkStatus();
    return At(what, index,
              Named(uri, absl::InvalidArgumentError(absl::StrCat(
                             sibling.outside, ", and is read only where that is allowed (--allow-outside)"))));
  }

  // The images of the textures that shaders read. The loader reports faults of the file there.
  std::vector<bool> WantedImages() const {
    std::vector<bool> wanted(json_["images"].size());
    if (!IsObjectArray(json_, "textures") || !IsObjectArray(json_, "materials")) return wanted;
    const Json& textures = json_["textures"];
    const auto want_image = [&](const Json& object) {
      const auto image = Unsigned(object, "source", UINT64_MAX);
      if (image && *image < wanted.size()) wanted[*image] = true;
    };
    const auto want = [&](const Json& material, const char* path) {
      const Json::json_pointer index(path);
      if (!material.contains(index) || !material[index].is_number_unsigned()) return;
      const auto texture = material[index].get<uint64_t>();
      if (texture >= textures.size()) return;
      want_image(textures[texture]);
      const auto extensions = textures[texture].find("extensions");
      if (extensions == textures[texture].end() || !extensions->is_object()) return;
      for (const Json& extension : *extensions) want_image(extension);
    };
    for (const Json& material : json_["materials"]) {
      if (outside_.wanted.base_color) {
        want(material, "/pbrMetallicRoughness/baseColorTexture/index");
        want(material, "/extensions/KHR_materials_pbrSpecularGlossiness/diffuseTexture/index");
      }
      if (outside_.wanted.emissive) want(material, "/emissiveTexture/index");
      if (outside_.wanted.metallic_roughness) want(material, "/pbrMetallicRoughness/metallicRoughnessTexture/index");
    }
    return wanted;
  }

  // Rewrites buffer and byteOffset of a buffer view or of its meshopt compression. A view that overruns its buffer
  // would read the next buffer after merging, so it is refused here.
  absl::Status Move(Json& view, size_t index) {
    const std::string name = absl::StrCat("bufferView ", index);
    const auto buffer = Unsigned(view, "buffer", UINT64_MAX);
    if (!buffer || *buffer >= places_.size()) return absl::InvalidArgumentError(name + ": its buffer does not exist");
    const BufferPlace& place = places_[*buffer];
    view["buffer"] = place.merged ? 0 : place.new_index;
    if (!place.merged) return absl::OkStatus();
    const auto offset = Unsigned(view, "byteOffset", 0), length = Unsigned(view, "byteLength", UINT64_MAX);
    if (!offset || !length || *offset > place.length || *length > place.length - *offset) {
      return absl::InvalidArgumentError(
          absl::StrCat(name, ": overruns buffer ", *buffer, " of ", place.length, " bytes"));
    }
    view["byteOffset"] = place.base + *offset;
    return absl::OkStatus();
  }

  absl::Status MoveViews() {
    if (!json_.contains("bufferViews")) return absl::OkStatus();
    if (!IsObjectArray(json_, "bufferViews")) return absl::InvalidArgumentError("bufferViews is not a list of objects");
    Json& views = json_["bufferViews"];
    for (size_t i = 0; i < views.size(); ++i) {
      if (absl::Status over = job_.Check(); !over.ok()) return over;
      if (absl::Status s = Move(views[i], i); !s.ok()) return s;
      const auto extensions = views[i].find("extensions");
      if (extensions == views[i].end() || !extensions->is_object()) continue;
      for (const char* name : {"EXT_meshopt_compression", "KHR_meshopt_compression"}) {
        const auto meshopt = extensions->find(name);
        if (meshopt == extensions->end() || !meshopt->is_object()) continue;
        if (absl::Status s = Move(*meshopt, i); !s.ok()) return s;
      }
    }
    return absl::OkStatus();
  }

  // Image files beside the glTF go into the BIN chunk. A missing one, or one elsewhere, stays a URI, which the loader
  // drops: a missing texture does not fail geometry.
  absl::Status EmbedImages() {
    if (!IsObjectArray(json_, "images")) return absl::OkStatus();
    const std::vector<bool> wanted = WantedImages();
    for (size_t i = 0; i < wanted.size(); ++i) {
      if (absl::Status over = job_.Check(); !over.ok()) return over;
      Json& image = json_["images"][i];
      const auto uri = FileUri(image);
      if (!uri) continue;
      const auto sibling = Resolve(*uri);
      if (absl::IsResourceExhausted(sibling.status())) return sibling.status();
      if (!sibling.ok()) continue;
      if (absl::Status s = CheckPlace("image", i, *uri, *sibling); !s.ok()) {
        if (wanted[i]) return s;
        continue;
      }
      const auto [view, fresh] = image_views_.try_emplace(sibling->path);
      if (fresh) {
        absl::StatusOr<std::optional<uint64_t>> added = AddView(sibling->path);
        if (!added.ok()) return added.status();
        view->second = *added;
      }
      if (!view->second) continue;
      image.erase("uri");
      image["bufferView"] = *view->second;
      if (!image.contains("mimeType")) image["mimeType"] = MimeType(sibling->path);
    }
    return absl::OkStatus();
  }

  // Puts a file into the BIN chunk. Out: its new buffer view; empty if it cannot be read.
  absl::StatusOr<std::optional<uint64_t>> AddView(const fs::path& path) {
    MemoryCharge charge(&MemoryOf(job_));
    const auto bytes = ReadSibling(path, limits_.max_file_bytes, charge);
    if (LimitErrorOf(bytes.status())) return bytes.status();
    if (!bytes.ok()) return std::optional<uint64_t>();
    constexpr uint64_t kBytesAView = 512;  // in the JSON
    if (absl::Status s = memory_.Grow(kBytesAView, "buffer views:"); !s.ok()) return s;
    uint64_t base = 0;
    if (absl::Status s = Append(*bytes, base); !s.ok()) return s;
    Json& views = json_["bufferViews"];
    if (views.is_null()) views = Json::array();
    views.push_back({{"buffer", 0}, {"byteLength", bytes->size()}, {"byteOffset", base}});
    return std::optional<uint64_t>(views.size() - 1);
  }

  static std::string MimeType(const fs::path& path) {
    const std::string extension = path.extension().string();
    if (extension == ".jpg" || extension == ".jpeg" || extension == ".JPG") return "image/jpeg";
    if (extension == ".webp") return "image/webp";
    if (extension == ".ktx2") return "image/ktx2";
    return "image/png";
  }

  absl::StatusOr<FileBytes> WriteGlb() {
    // Its text takes no more than the tree.
    if (absl::Status s = memory_.Grow(json_bytes_, "the packed mesh:"); !s.ok()) return s;
    if (absl::Status over = job_.Check(); !over.ok()) return over;
    std::string text = json_.dump(-1, ' ', false, Json::error_handler_t::replace);
    text.resize((text.size() + 3) / 4 * 4, ' ');
    if (absl::Status s = Align(); !s.ok()) return s;
    const uint64_t total = 12 + 8 + text.size() + 8 + bin_.size();
    if (total > limits_.max_file_bytes || total > UINT32_MAX) {
      return absl::ResourceExhaustedError(absl::StrCat("the packed mesh has ", total, " bytes, the limit is ",
                                                       std::min<uint64_t>(limits_.max_file_bytes, UINT32_MAX),
                                                       " bytes"));
    }
    if (absl::Status s = memory_.Grow(total, "the packed mesh:"); !s.ok()) return s;
    if (absl::Status over = job_.Check(); !over.ok()) return over;
    FileBytes glb;
    glb.reserve(total);
    const auto word = [&](uint32_t v) {
      for (int i = 0; i < 4; ++i) glb.push_back(uint8_t(v >> (8 * i)));
    };
    word(0x46546c67);  // "glTF"
    word(2);
    word(uint32_t(total));
    word(uint32_t(text.size()));
    word(0x4e4f534a);  // "JSON"
    glb.insert(glb.end(), text.begin(), text.end());
    word(uint32_t(bin_.size()));
    word(0x004e4942);  // "BIN"
    glb.insert(glb.end(), bin_.begin(), bin_.end());
    return glb;
  }

  // Where the first bytes of a file lie in the BIN chunk.
  struct MergedFile {
    uint64_t base = 0, length = 0;
    uint64_t file_bytes = 0;  // of all of it
  };

  const JobContext& job_;
  Json json_;
  MemoryCharge memory_;  // of all that this holds
  const uint64_t json_bytes_ = memory_.bytes();
  std::map<std::string, absl::StatusOr<SiblingFile>> siblings_;  // by URI
  std::map<fs::path, MergedFile> merged_;                        // of buffers
  std::map<fs::path, std::optional<uint64_t>> image_views_;      // of images; empty if it cannot be read
  std::optional<std::span<const uint8_t>> binary_;
  fs::path directory_;
  const LoadLimits& limits_;
  const OutsideFiles& outside_;
  std::vector<BufferPlace> places_;
  std::vector<uint8_t> bin_;
};

}  // namespace

absl::StatusOr<PackedMesh> ReadAndPackMeshFile(const std::string& path, const LoadLimits& limits, WarningList* warnings,
                                               const OutsideFiles& outside) {
  const auto named = [&path](const absl::Status& why) {
    return WithText(why, absl::StrCat(path, ": ", std::string(why.message())));
  };
  auto bytes = ReadLocalFile(path, limits.max_file_bytes);
  if (!bytes.ok()) return named(bytes.status());
  const JobContext endless;
  PackedMesh mesh;
  mesh.format = FormatToTell(endless, *bytes, path).value_or(MeshFormat::kAuto);
  const fs::path directory = fs::path(path).parent_path();
  auto packed = PackMesh(endless, *std::move(bytes), directory, limits, warnings, outside, mesh.format);
  if (!packed.ok()) return named(packed.status());
  mesh.bytes = *std::move(packed);
  return mesh;
}

absl::StatusOr<FileBytes> PackMesh(const JobContext& job, FileBytes bytes, const fs::path& directory,
                                   const LoadLimits& limits, WarningList* warnings, const OutsideFiles& outside,
                                   MeshFormat format) {
  try {
    if (format == MeshFormat::kAuto) {
      const absl::StatusOr<MeshFormat> detected = DetectMeshFormat(job, bytes);
      if (!detected.ok()) return detected.status();
      format = *detected;
    }
    if (format == MeshFormat::kObj) {
      absl::StatusOr<std::optional<FileBytes>> packed = PackObj(job, bytes, directory, limits, outside);
      if (!packed.ok()) return packed.status();
      return *packed ? **std::move(packed) : std::move(bytes);
    }
    std::optional<Source> source = Parse(job, bytes, format, limits);
    if (absl::Status over = job.Check(); !over.ok()) return over;
    if (!source) return bytes;
    if (warnings != nullptr) warnings->Append(source->warnings);
    return Packer(job, *std::move(source), directory, limits, outside).Pack();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while packing");
  } catch (const std::exception& e) {  // nlohmann-json
    return absl::InvalidArgumentError(e.what());
  }
}

}  // namespace voxelpipe
