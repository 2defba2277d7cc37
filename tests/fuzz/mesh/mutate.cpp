#include "fuzz/mesh/mutate.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "shaders/catalog.h"

namespace voxelpipe::fuzz {
namespace {

using nlohmann::json;

uint64_t Below(Random& random, uint64_t count) {
  return random() % count;
}

bool OneIn(Random& random, uint64_t count) {
  return Below(random, count) == 0;
}

template <typename List>
const auto& Pick(const List& list, Random& random) {
  return *(std::begin(list) + int64_t(Below(random, uint64_t(std::size(list)))));
}

// Numbers at the edges of what a loader computes with.
json InterestingNumber(Random& random, const json& was) {
  static const json kNumbers = json::parse(R"([
      0, 1, -1, 2, 3, 4, 7, 8, 255, 256, 65535, 65536, 16777216, 2147483647, 2147483648, 4294967295, 4294967296,
      1e7, 1e9, 1e15,
      -2147483648.0, 0.5, -0.0, 1e-30, 1e30, 1e38, 1e39, 1e300, 1e-300, 9007199254740993, 9223372036854775807,
      18446744073709551615, 5120, 5121, 5123, 5125, 5126])");
  if (was.is_number_integer() && OneIn(random, 2)) return int64_t(was.get<uint64_t>() + Below(random, 5) - 2);
  if (was.is_number() && OneIn(random, 4)) return was.get<double>() * double(1 << Below(random, 20));
  return Pick(kNumbers, random);
}

json InterestingValue(Random& random, const json& was) {
  static const json kValues = [] {
    json values = json::parse(R"([null, true, false, "", [], {}, [0], [{"index": 0}],
        "POSITION", "VEC3", "SCALAR", "MAT4", "TRIANGLES", "ATTRIBUTES", "INDICES", "OCTAHEDRAL", "QUATERNION",
        "EXPONENTIAL",
        "data:application/octet-stream;base64,AAAA", "data:,", "data:image/png;base64,", "../x"])");
    values.push_back("\xff\xfe");
    values.push_back(std::string(3000, 'x'));
    return values;
  }();
  return OneIn(random, 2) ? InterestingNumber(random, was) : Pick(kValues, random);
}

// All values of a document, in order.
void Collect(json& value, std::vector<json*>& all) {
  all.push_back(&value);
  if (value.is_structured()) {
    for (json& child : value) Collect(child, all);
  }
}

void SpoilOne(json& document, Random& random) {
  std::vector<json*> all;
  Collect(document, all);
  json& value = *all[Below(random, all.size())];
  if (value.is_number() && !OneIn(random, 8)) {
    value = InterestingNumber(random, value);
    return;
  }
  if (value.is_object() && !value.empty() && !OneIn(random, 6)) {
    auto child = value.begin();
    std::advance(child, int64_t(Below(random, value.size())));
    const json kept = child.value();
    switch (Below(random, 4)) {
      case 0: value.erase(child); return;
      case 1: child.value() = InterestingValue(random, kept); return;
      case 2: value[OneIn(random, 2) ? "extras" : child.key() + "_"] = kept; return;
      default: child.value() = *all[Below(random, all.size())]; return;  // something from elsewhere
    }
  }
  if (value.is_array() && !value.empty() && !OneIn(random, 6)) {
    const size_t at = Below(random, value.size());
    switch (Below(random, 4)) {
      case 0: value.erase(at); return;
      case 1: value[at] = InterestingValue(random, value[at]); return;
      case 2: value.push_back(json(value[at])); return;
      default:
        for (uint64_t i = Below(random, 64); i > 0; --i) value.push_back(json(value[at]));
        return;
    }
  }
  value = InterestingValue(random, json(value));
}

// A file of a document and its bytes, whose container may be spoilt too.
std::vector<uint8_t> Write(const Seed& seed, testing::GlbBuilder gltf, Random& random) {
  if (!gltf.bin.empty() && OneIn(random, 3)) SpoilBytes(gltf.bin, random);
  json buffer = {{"byteLength", gltf.bin.size()}};
  if (seed.text) buffer["uri"] = "data:application/octet-stream;base64," + testing::Base64(gltf.bin);
  gltf.doc["buffers"] = json::array({buffer});
  if (!OneIn(random, 5)) SpoilJson(gltf.doc, random);
  const std::string text = gltf.doc.dump(-1, ' ', false, json::error_handler_t::replace);
  std::vector<uint8_t> bytes =
      seed.text ? std::vector<uint8_t>(text.begin(), text.end()) : testing::PackGlb(text, gltf.bin);
  if (OneIn(random, 6)) SpoilBytes(bytes, random);
  return bytes;
}

TargetSpec RandomTarget(Random& random) {
  static const std::vector<std::string> kShaders = [] {
    std::vector<std::string> names;
    for (const ShaderInfo& shader : ListShaders()) {
      if (shader.stage == ShaderStage::kFragment) names.push_back(shader.name);
    }
    return names;
  }();
  TargetSpec target;
  target.shader.name = Pick(kShaders, random);
  if (target.shader.name == "attribute") target.shader.text["name"] = OneIn(random, 2) ? "_HEAT" : "COLOR_0";
  target.format = Pick(std::vector{VoxelFormat::kBit, VoxelFormat::kU8, VoxelFormat::kU16, VoxelFormat::kU32,
                                   VoxelFormat::kF16, VoxelFormat::kF32},
                       random);
  target.blend = Pick(std::vector{Blend::kOr, Blend::kReplace, Blend::kMin, Blend::kMax, Blend::kAdd, Blend::kFirst,
                                  Blend::kAverage, Blend::kCount, Blend::kAnd},
                      random);
  target.components = target.format == VoxelFormat::kBit ? 1 : 1 + int(Below(random, 4));
  if (OneIn(random, 10)) target.components = int(Below(random, 7)) - 1;
  if (OneIn(random, 10)) target.scale = std::ldexp(1.0, int(Below(random, 200)) - 100);
  if (OneIn(random, 20)) target.quantum = std::ldexp(1.0, int(Below(random, 400)) - 200);
  if (OneIn(random, 10)) target.clear = Pick(std::vector{-1.0, 0.5, 1e300, double(NAN), double(INFINITY)}, random);
  if (OneIn(random, 10))
    target.fill_values.assign(Below(random, 5), Pick(std::vector{-1.0, 2.0, 1e300, double(NAN)}, random));
  if (OneIn(random, 10)) target.encoding = OneIn(random, 2) ? Encoding::kSrgb : Encoding::kSnorm;
  return target;
}

VoxelizeRequest RandomRequest(Random& random) {
  VoxelizeRequest request;
  GridRequest& grid = request.grid;
  const auto size = [&] {
    return Pick(std::vector{0.1, 0.25, 1.0, 1e-3, 1e-300, 1e300, 0.0, -1.0, double(NAN), double(INFINITY)}, random);
  };
  switch (Below(random, 8)) {
    case 0: grid.voxel_size = Vec3d{0.1, 0.1, 0.1}; break;
    case 1: grid.voxel_size = Vec3d{size(), size(), size()}; break;
    case 2:
      grid.dims = {int64_t(1 + Below(random, 40)), int64_t(1 + Below(random, 40)), int64_t(1 + Below(random, 40))};
      grid.origin = Vec3d{-1, -1, -1};
      grid.voxel_size = Vec3d{0.1, 0.2, 0.3};
      break;
    case 3:
      grid.dims = {int64_t(Below(random, 1 << 20)), int64_t(Below(random, 1 << 20)) - 2,
                   int64_t(1) << Below(random, 63)};
      grid.origin = Vec3d{size(), size(), size()};
      grid.voxel_size = Vec3d{size(), size(), size()};
      break;
    default: grid.resolution = int64_t(1 + Below(random, 48)); break;
  }
  if (OneIn(random, 40)) grid.resolution = Pick(std::vector<int64_t>{0, -1, 4096, 100000, INT64_MAX}, random);
  if (OneIn(random, 8)) grid.padding = Pick(std::vector<int64_t>{1, 2, 5, 1000, -1, INT64_MAX}, random);
  request.coverage =
      Pick(std::vector{Coverage::kConservative, Coverage::kThin, Coverage::kCenter, Coverage::kNone}, random);
  request.fill = Pick(std::vector{Fill::kNone, Fill::kNone, Fill::kParity, Fill::kFlood, Fill::kNonzero}, random);
  request.result =
      Pick(std::vector{ResultKind::kDense, ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}, random);
  request.layout = OneIn(random, 4) ? Layout::kPlanar : Layout::kInterleaved;
  if (OneIn(random, 3)) {
    request.targets.clear();
    for (uint64_t i = 1 + Below(random, OneIn(random, 10) ? 12 : 3); i > 0; --i)
      request.targets.push_back(RandomTarget(random));
  } else if (OneIn(random, 2)) {  // what samples textures
    TargetSpec target;
    target.format = VoxelFormat::kF32;
    target.components = 4;
    target.blend = Blend::kReplace;
    target.shader.name = OneIn(random, 2) ? "base_color" : "emissive";
    request.targets = {target};
  }
  request.backend = BackendChoice::kCpu;
  return request;
}

}  // namespace

void SpoilBytes(std::vector<uint8_t>& bytes, Random& random) {
  for (uint64_t i = 1 + Below(random, 6); i > 0; --i) {
    if (bytes.empty()) return;
    const size_t at = Below(random, bytes.size());
    switch (Below(random, 7)) {
      case 0: bytes[at] ^= uint8_t(1u << Below(random, 8)); break;
      case 1: bytes[at] = uint8_t(random()); break;
      case 2: bytes[at] = OneIn(random, 2) ? 0xff : 0; break;
      case 3: {  // a word
        const uint32_t word = Pick(
            std::vector<uint32_t>{0, 1, 0x7fffffff, 0x80000000, 0xffffffff, 0x7fc00000, 0x7f800000, 0x10000}, random);
        for (size_t k = 0; k < 4 && at + k < bytes.size(); ++k) bytes[at + k] = uint8_t(word >> (8 * k));
        break;
      }
      case 4: bytes.resize(at); break;
      case 5:
        bytes.erase(bytes.begin() + int64_t(at),
                    bytes.begin() + int64_t(std::min(bytes.size(), at + 1 + Below(random, 8))));
        break;
      default: {
        const std::vector<uint8_t> part(bytes.begin() + int64_t(at),
                                        bytes.begin() + int64_t(std::min(bytes.size(), at + 1 + Below(random, 32))));
        bytes.insert(bytes.begin() + int64_t(Below(random, bytes.size())), part.begin(), part.end());
      }
    }
  }
}

void SpoilJson(json& document, Random& random) {
  for (uint64_t i = 1 + Below(random, 4); i > 0; --i) SpoilOne(document, random);
}

Case MakeCase(uint64_t seed, uint64_t number) {
  Random random(seed * 0x9E3779B97F4A7C15ull + number);
  const Seed& from = Pick(Seeds(), random);
  Case made;
  made.seed = from.name;
  if (from.file.empty()) {
    made.mesh = Write(from, from.gltf, random);
  } else {
    made.mesh = from.file;
    SpoilBytes(made.mesh, random);
  }
  made.request = RandomRequest(random);
  return made;
}

}  // namespace voxelpipe::fuzz
