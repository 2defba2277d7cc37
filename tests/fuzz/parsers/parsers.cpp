#include "fuzz/parsers/parsers.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "base/memory_budget.h"
#include "batch/manifest.h"
#include "fuzz/mesh/seeds.h"
#include "load/decode/image.h"
#include "load/load_job.h"
#include "mesh/flatten_job.h"
#include "request_text/axes.h"
#include "request_text/numbers.h"
#include "request_text/shader_text.h"
#include "request_text/target_text.h"
#include "support/meshes/zip_maker.h"
#ifdef VOXELPIPE_FUZZ_WEB
#include "web/http/frames.h"
#include "web/http/origin_rules.h"
#include "web/http/request_body.h"
#endif

namespace voxelpipe::fuzz {
namespace {

using Bytes = std::span<const uint8_t>;
using Files = std::vector<std::vector<uint8_t>>;
using nlohmann::json;
using testing::GlbBuilder;

// What a few bytes may ask for stays small, so that a process under a sanitizer keeps within its memory.
constexpr uint64_t kMaxBytes = 64 << 20;

LoadLimits SmallLimits() {
  LoadLimits limits;
  limits.max_triangles = limits.max_vertices = 1 << 20;
  limits.max_instances = limits.max_nodes = 1 << 14;
  limits.max_image_pixels = limits.max_total_image_pixels = 1 << 20;
  return limits;
}

std::string Text(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
std::vector<uint8_t> BytesOf(std::string_view text) {
  return {text.begin(), text.end()};
}

// The whole way of a mesh but for the pipeline.
void Load(Bytes bytes, MeshFormat format) {
  const LoadLimits limits = SmallLimits();
  MemoryBudget memory(kMaxBytes);  // whose end finds what was not given back
  JobContext job;
  job.set_memory(&memory);
  const absl::StatusOr<Scene> scene = LoadSceneFor(job, bytes, format, limits);
  if (!scene.ok()) return;
  absl::StatusOr<TriangleMesh> mesh = FlattenFor(job, *scene, limits);
  if (mesh.ok()) static_cast<void>(PrepareTexturesFor(job, *mesh, limits, {true, true, true}));
}

void RunGltf(Bytes bytes) {
  Load(bytes, MeshFormat::kGltf);
}
void RunGlb(Bytes bytes) {
  Load(bytes, MeshFormat::kGlb);
}
void RunDraco(Bytes bytes) {
  Load(bytes, MeshFormat::kDraco);
}

// A quad whose base colour is the image. The first byte says what type it claims to be.
void RunImage(Bytes bytes) {
  if (bytes.empty()) return;
  constexpr const char* kTypes[] = {"image/png", "image/jpeg", "image/webp", ""};
  GlbBuilder b;
  json primitive = b.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  primitive["attributes"]["TEXCOORD_0"] = b.Vectors({0, 0, 1, 0, 0, 1}, "VEC2");
  primitive["material"] = 0;
  const int view = b.View({bytes.begin() + 1, bytes.end()});
  b.doc["images"] = {{{"bufferView", view}, {"mimeType", kTypes[bytes[0] % 4]}}};
  b.doc["textures"] = {{{"source", 0}}};
  b.doc["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  b.Mesh(primitive);
  b.Node({{"mesh", 0}});
  b.Scene({0});
  Load(b.Glb(), MeshFormat::kGlb);
}

// Positions in a compressed view; four bytes before it say mode, filter, stride and count.
void RunMeshopt(Bytes bytes) {
  if (bytes.size() < 5) return;
  constexpr const char* kModes[] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
  constexpr const char* kFilters[] = {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"};
  const int stride = bytes[2] % 65, count = bytes[3];
  GlbBuilder b;
  const int compressed = b.View({bytes.begin() + 4, bytes.end()});
  json object = b.doc["bufferViews"][size_t(compressed)];
  object.update(
      {{"byteStride", stride}, {"count", count}, {"mode", kModes[bytes[0] % 3]}, {"filter", kFilters[bytes[1] % 4]}});
  const int view = b.View(testing::ByteVector(size_t(stride * count), 0));
  b.doc["bufferViews"][size_t(view)]["extensions"]["EXT_meshopt_compression"] = object;
  b.doc["extensionsRequired"] = b.doc["extensionsUsed"] = {"EXT_meshopt_compression"};
  if (bytes[0] % 3 == 0) {
    const int accessor = b.Accessor(view, testing::kF32, "VEC3", uint64_t(count));
    b.Mesh({{"attributes", {{"POSITION", accessor}}}});
  } else {
    json primitive = b.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
    primitive["indices"] = b.Accessor(view, stride == 2 ? testing::kU16 : testing::kU32, "SCALAR", uint64_t(count));
    b.Mesh(primitive);
  }
  b.Node({{"mesh", 0}});
  b.Scene({0});
  Load(b.Glb(), MeshFormat::kGlb);
}

// A buffer whose URI is "data:" and the bytes.
void RunDataUri(Bytes bytes) {
  GlbBuilder b;
  b.doc["buffers"] = {{{"byteLength", 36}, {"uri", "data:" + Text(bytes)}}};
  b.doc["bufferViews"] = {{{"buffer", 0}, {"byteLength", 36}}};
  b.doc["accessors"] = {{{"bufferView", 0}, {"componentType", testing::kF32}, {"count", 3}, {"type", "VEC3"}}};
  b.Mesh({{"attributes", {{"POSITION", 0}}}});
  b.Node({{"mesh", 0}});
  b.Scene({0});
  Load(BytesOf(b.doc.dump(-1, ' ', false, json::error_handler_t::replace)), MeshFormat::kGltf);
}

void RunManifest(Bytes bytes) {
  const int file = memfd_create("manifest", MFD_CLOEXEC);
  if (file < 0) return;
  if (write(file, bytes.data(), bytes.size()) == ssize_t(bytes.size())) {
    const cli::ManifestDefaults defaults;
    static_cast<void>(cli::ManifestReader::Open(absl::StrCat("/proc/self/fd/", file), defaults));
  }
  close(file);
}

// The small languages of the command line.
void RunOptions(Bytes bytes) {
  const std::string text = Text(bytes);
  static_cast<void>(ParseVoxelSize(text));
  static_cast<void>(ParsePoint(text));
  static_cast<void>(ParseDims(text));
  static_cast<void>(ParseAxes(text));
  static_cast<void>(ParseBox(text));
  static_cast<void>(ParseShaderCall(text));
  static_cast<void>(ParseTarget(text, {"occupancy", {}}));
  static_cast<void>(cli::ParseShard(text));
}

#ifdef VOXELPIPE_FUZZ_WEB
void Demand(bool good, const char* what) {
  if (good) return;
  std::fprintf(stderr, "web: %s\n", what);
  std::abort();
}

// What a browser sends, a line each: Host, Origin, an option with origins, grpc-timeout. The rest is a body, in pieces
// of as many bytes as the first one says.
void RunWeb(Bytes bytes) {
  std::string_view rest(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const auto line = [&rest] {
    const size_t end = std::min(rest.find('\n'), rest.size());
    const std::string_view one = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    return one;
  };
  const std::string_view host = line(), origin = line(), origins = line(), timeout = line();
  auto allowed = ParseOrigins(origins);
  const OriginRules rules("127.0.0.1:8080", allowed.ok() ? *std::move(allowed) : std::vector<std::string>());
  const RequestSource source{host, origin, std::nullopt};
  if (rules.Check(source).ok() && !rules.IsForeignAllowed(source)) {
    Demand(origin.size() == host.size() + 7, "a foreign origin passes");
  }
  if (const auto time = ParseTimeout(timeout); time.ok()) Demand(time->count() >= 0, "a time-out below 0");
  for (const char c : PercentEncoded(rest)) Demand(c >= ' ' && c <= '~', "a byte that no header may have");

  ByteBudget budget(64 << 10);
  RequestBody body(kFrameHeadBytes, 48 << 10, budget, std::chrono::hours(1));
  const size_t piece = rest.empty() ? 1 : size_t(uint8_t(rest[0])) + 1;
  for (size_t at = 0; at < rest.size(); at += piece) {
    if (body.Append(rest.substr(at, piece)) != RequestBody::Took::kGood) return;
  }
  const bool framed = CheckRequestFrame(body.head(), body.bytes()).ok();
  const size_t message = rest.size() - std::min(rest.size(), kFrameHeadBytes);
  if (body.status().ok()) Demand(body.Take().Length() == message, "bytes of the body are lost");
  if (framed) Demand(rest.size() >= kFrameHeadBytes && rest[0] == 0, "a frame that is none");
}
#endif

Files SeedFiles(bool text) {
  Files files;
  for (const Seed& seed : Seeds()) {
    if (seed.file.empty()) files.push_back(text ? seed.gltf.Gltf() : seed.gltf.Glb());
  }
  return files;
}
Files GltfSeeds() {
  return SeedFiles(true);
}
Files GlbSeeds() {
  return SeedFiles(false);
}
Files DracoSeeds() {
  return {DracoStream(false), DracoStream(true)};
}
void RunStl(Bytes bytes) {
  Load(bytes, MeshFormat::kStl);
}
void RunPly(Bytes bytes) {
  Load(bytes, MeshFormat::kPly);
}
void RunOff(Bytes bytes) {
  Load(bytes, MeshFormat::kOff);
}
void RunObj(Bytes bytes) {
  Load(bytes, MeshFormat::kObj);
}
// The archive as it is, and the bytes as the model in a good one: a fuzzer finds no CRC-32 by itself.
void RunThreemf(Bytes bytes) {
  Load(bytes, MeshFormat::k3mf);
  testing::ZipMaker zip = testing::Package3mf(Text(bytes));
  zip.Add("3D/a.png", "no picture");
  const std::string package = zip.Bytes();
  Load({reinterpret_cast<const uint8_t*>(package.data()), package.size()}, MeshFormat::k3mf);
}
Files ThreemfSeeds() {
  Files files = ThreemfFiles();
  files.push_back(BytesOf(testing::Model3mf(
      "<basematerials id=\"5\"><base name=\"red\" displaycolor=\"#FF0000\"/></basematerials><object id=\"1\" pid=\"5\" "
      "pindex=\"0\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" y=\"0\" z=\"0\"/><vertex x=\"0\" "
      "y=\"1\" z=\"0\"/></vertices><triangles><triangle v1=\"0\" v2=\"1\" "
      "v3=\"2\"/></triangles></mesh></object><object "
      "id=\"2\"><components><component objectid=\"1\"/></components></object>",
      "<item objectid=\"2\" transform=\"1 0 0 0 1 0 0 0 1 4 5 6\"/>")));
  return files;
}
Files ImageSeeds() {
  std::vector<uint8_t> png = testing::MakePng(3, 2, testing::ByteVector(24, 90));
  png.insert(png.begin(), 0);
  return {png};
}
Files MeshoptSeeds() {
  Files files;
  for (const Seed& seed : Seeds()) {
    if (seed.name != "meshopt") continue;
    for (const json& view : seed.gltf.doc["bufferViews"]) {
      const auto extension = view.find("extensions");
      if (extension == view.end()) continue;
      const json& object = (*extension)["EXT_meshopt_compression"];
      const auto offset = object.value("byteOffset", size_t{0}), length = object.at("byteLength").get<size_t>();
      std::vector<uint8_t> bytes = {uint8_t(object["mode"] == "TRIANGLES"), 0, object["byteStride"].get<uint8_t>(),
                                    object["count"].get<uint8_t>()};
      const auto begin = seed.gltf.bin.begin() + int64_t(offset);
      bytes.insert(bytes.end(), begin, begin + int64_t(length));
      files.push_back(std::move(bytes));
    }
  }
  return files;
}
Files DataUriSeeds() {
  const std::string zeros(48, 'A');
  return {BytesOf("application/octet-stream;base64," + zeros), BytesOf(",%00%01%02"),
          BytesOf("text/plain;charset=x,abc")};
}
Files ManifestSeeds() {
  return {BytesOf(R"({"input":"a.glb","id":"x","resolution":9,"target":["bit:or","f32x3:replace:shader=normal"]})"
                  "\n"
                  R"({"input":"b.glb","voxel-size":[1,2,3],"fill":"parity","format":"raw","preview":"p.png"})")};
}
#ifdef VOXELPIPE_FUZZ_WEB
Files WebSeeds() {
  std::string good = "127.0.0.1:8080\nhttp://127.0.0.1:8080\nhttps://a.example,http://[::1]:9\n250m\n";
  good += std::string("\0\0\0\0\3abc", 8);
  return {BytesOf(good), BytesOf("[::1]:80\nhttps://a.example\nhttps://a.example\n1H\n\x80")};
}
#endif
Files OptionSeeds() {
  return {BytesOf("1,2.5,-3"), BytesOf("constant:value=0.5/0.2/1"),
          BytesOf("u8x4:replace:shader=base_color,scale=2,clear=1"), BytesOf("3/8"),
          BytesOf("f32:add:shader=attribute(_HEAT),quantum=0.5")};
}

constexpr Parser kParsers[] = {
    {"gltf", &RunGltf, &GltfSeeds},
    {"glb", &RunGlb, &GlbSeeds},
    {"draco", &RunDraco, &DracoSeeds},
    {"stl", &RunStl, &StlFiles},
    {"ply", &RunPly, &PlyFiles},
    {"off", &RunOff, &OffFiles},
    {"obj", &RunObj, &ObjFiles},
    {"threemf", &RunThreemf, &ThreemfSeeds},
    {"image", &RunImage, &ImageSeeds},
    {"meshopt", &RunMeshopt, &MeshoptSeeds},
    {"data_uri", &RunDataUri, &DataUriSeeds},
    {"manifest", &RunManifest, &ManifestSeeds},
    {"options", &RunOptions, &OptionSeeds},
#ifdef VOXELPIPE_FUZZ_WEB
    {"web", &RunWeb, &WebSeeds},
#endif
};

}  // namespace

std::span<const Parser> Parsers() {
  return kParsers;
}

const Parser* FindParser(std::string_view name) {
  for (const Parser& parser : kParsers) {
    if (name == parser.name) return &parser;
  }
  return nullptr;
}

}  // namespace voxelpipe::fuzz
