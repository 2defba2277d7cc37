// Source: glTF 2.0 specification, section 3.11.
#include "load/gltf/gltf_animations.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "base/limit_error.h"
#include "load/gltf/document/gltf_fields.h"
#include "mesh/scene/scene_bytes.h"

namespace voxelpipe::gltf {
namespace {

constexpr const char* kPaths[] = {"translation", "rotation", "scale", "weights"};

// Number of morph targets of each mesh: the largest of its primitives.
std::vector<uint64_t> TargetsOf(const std::vector<Mesh>& meshes) {
  std::vector<uint64_t> targets;
  for (const Mesh& mesh : meshes) {
    uint64_t most = 0;
    for (const Primitive& primitive : mesh.primitives) {
      if (primitive.morph != nullptr) most = std::max<uint64_t>(most, primitive.morph->targets.size());
    }
    targets.push_back(most);
  }
  return targets;
}

class Reader {
 public:
  // `targets`: the number of morph targets of each mesh. All but `where` must outlive this.
  Reader(const AccessorReader& accessors, uint64_t accessor_count, const Scene& scene,
         const std::vector<uint64_t>& targets, std::string where)
      : accessors_(accessors),
        accessor_count_(accessor_count),
        scene_(scene),
        mesh_targets_(targets),
        where_(std::move(where)) {}

  absl::Status Read(const Json& object, Animation& out) {
    absl::Status status;
    Fields fields(object, where_, status);
    const Json* samplers = fields.Array("samplers");
    const Json* channels = fields.Array("channels");
    if (samplers == nullptr || channels == nullptr) fields.Fail("samplers or channels are missing");
    if (!status.ok()) return status;
    out.name = fields.String("name");
    status = absl::OkStatus();          // an invalid name is no error
    std::map<uint64_t, uint32_t> read;  // samplers by the file's index; those without a channel are not read
    for (size_t i = 0; i < channels->size(); ++i) {
      if (absl::Status over = accessors_.job().Check(); !over.ok()) return over;
      if (absl::Status bad = ReadChannel((*channels)[i], i, *samplers, read, out); !bad.ok()) return bad;
    }
    return absl::OkStatus();
  }

 private:
  absl::Status ReadChannel(const Json& object, size_t index, const Json& samplers, std::map<uint64_t, uint32_t>& read,
                           Animation& out) {
    absl::Status status;
    Fields fields(object, absl::StrCat(where_, ", channel ", index), status);
    const uint32_t sampler = fields.RequiredIndex("sampler", samplers.size(), "samplers");
    const Json* target = fields.Find("target");
    if (target == nullptr) fields.Fail("target is missing");
    if (!status.ok()) return status;
    Fields target_fields(*target, fields.where() + ", target", status);
    const int64_t node = target_fields.Index("node", scene_.nodes.size(), "nodes");
    const std::string name = target_fields.String("path");
    if (!status.ok()) return status;
    const auto* path = std::find(std::begin(kPaths), std::end(kPaths), name);
    if (node < 0 || path == std::end(kPaths)) return absl::OkStatus();

    AnimationChannel channel{static_cast<uint32_t>(node), AnimationPath(path - std::begin(kPaths)), 0};
    if (!targets_.emplace(channel.node, channel.path).second) {
      fields.Fail(absl::StrCat("node ", node, " has a channel for ", name, " already"));
      return status;
    }
    const bool weights = channel.path == AnimationPath::kWeights;
    if (!weights && scene_.nodes[channel.node].has_matrix) {
      fields.Fail(absl::StrCat("node ", node, " has a matrix and cannot be animated"));
      return status;
    }
    const int32_t mesh = scene_.nodes[channel.node].mesh;
    const uint64_t width = weights                                    ? (mesh < 0 ? 0 : mesh_targets_[size_t(mesh)])
                           : channel.path == AnimationPath::kRotation ? 4
                                                                      : 3;
    if (width == 0) {
      // Hidden nodes have no mesh; a missing morph target there is no error.
      if (mesh < 0) return absl::OkStatus();
      fields.Fail(absl::StrCat("node ", node, " has no morph targets"));
      return status;
    }
    const auto [place, fresh] = read.try_emplace(sampler, static_cast<uint32_t>(out.samplers.size()));
    if (fresh) {
      AnimationSampler& to = out.samplers.emplace_back();
      to.width = static_cast<uint32_t>(width);
      if (absl::Status bad = ReadSampler(samplers[sampler], sampler, to); !bad.ok()) return bad;
    } else if (out.samplers[place->second].width != width) {
      fields.Fail(absl::StrCat("sampler ", sampler, " serves channels of different widths"));
      return status;
    }
    channel.sampler = place->second;
    out.channels.push_back(channel);
    return absl::OkStatus();
  }

  absl::Status ReadSampler(const Json& object, size_t index, AnimationSampler& out) {
    absl::Status status;
    Fields fields(object, absl::StrCat(where_, ", sampler ", index), status);
    const uint32_t input = fields.RequiredIndex("input", accessor_count_, "accessors");
    const uint32_t output = fields.RequiredIndex("output", accessor_count_, "accessors");
    const std::string how = fields.String("interpolation", "LINEAR");
    if (!status.ok()) return status;
    if (how == "STEP") {
      out.interpolation = Interpolation::kStep;
    } else if (how == "CUBICSPLINE") {
      out.interpolation = Interpolation::kCubicSpline;
    } else if (how != "LINEAR") {
      fields.Fail("interpolation is none of LINEAR, STEP and CUBICSPLINE");
      return status;
    }
    if (absl::Status bad = ReadTimes(input, fields.where(), out); !bad.ok()) return bad;
    const uint64_t keys = out.times.size();
    const uint64_t wanted = keys * out.width * (out.interpolation == Interpolation::kCubicSpline ? 3 : 1);
    const AccessorDecl& decl = accessors_.decl(output);
    if (decl.matrix || decl.count > UINT64_MAX / 16 || decl.count * uint64_t(decl.components) != wanted ||
        (out.width == 4 ? decl.components != 4 && decl.components != 1
                        : decl.components != 3 && decl.components != 1)) {
      fields.Fail(absl::StrCat("output (accessor ", output, ") has ", decl.count, " elements of ", decl.components,
                               " components; ", keys, " keys want ", wanted, " numbers"));
      return status;
    }
    absl::StatusOr<std::vector<float>> values = accessors_.Floats(output);
    if (!values.ok()) return At(fields.where(), values.status());
    for (size_t i = 0; i < values->size(); ++i) {
      if (std::isfinite((*values)[i])) continue;
      fields.Fail(absl::StrCat("output (accessor ", output, "), number ", i, " is not finite"));
      return status;
    }
    out.values = *std::move(values);
    return absl::OkStatus();
  }

  absl::Status ReadTimes(uint32_t input, const std::string& where, AnimationSampler& out) {
    const auto broken = [&](const std::string& what) {
      return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": input (accessor ", input, ") ", what));
    };
    if (accessors_.decl(input).components != 1) return broken("is not SCALAR");
    absl::StatusOr<std::vector<float>> times = accessors_.Floats(input);
    if (!times.ok()) return At(where, times.status());
    if (times->empty()) return broken("has no keys");
    for (size_t i = 0; i < times->size(); ++i) {
      if (!std::isfinite((*times)[i])) return broken(absl::StrCat("has a time that is not finite, key ", i));
      if (i > 0 && !((*times)[i] > (*times)[i - 1])) return broken(absl::StrCat("does not ascend at key ", i));
    }
    out.times = *std::move(times);
    return absl::OkStatus();
  }

  static absl::Status At(const std::string& where, const absl::Status& why) {
    return WithText(why, absl::StrCat("glTF: ", where, ": ", absl::StripPrefix(why.message(), "glTF: ")));
  }

  const AccessorReader& accessors_;
  uint64_t accessor_count_;
  const Scene& scene_;
  const std::vector<uint64_t>& mesh_targets_;
  std::string where_;
  std::set<std::pair<uint32_t, AnimationPath>> targets_;  // of the channels read so far
};

}  // namespace

absl::Status ReadAnimations(const Document& document, const AccessorReader& accessors, Budget& budget, Scene& scene) {
  if (document.animations == nullptr) return absl::OkStatus();
  const Json& root = *document.animations;
  const uint64_t most = budget.limits().max_nodes;
  if (root.size() > most) {
    return absl::ResourceExhaustedError(
        absl::StrCat("glTF: ", root.size(), " animations; the limit max_nodes is ", most));
  }
  if (absl::Status full = budget.Take(root.size(), sizeof(Animation), "animations"); !full.ok()) return full;
  scene.animations.reserve(root.size());
  const std::vector<uint64_t> targets = TargetsOf(scene.meshes);
  uint64_t total = root.size();
  for (size_t i = 0; i < root.size(); ++i) {
    Animation& out = scene.animations.emplace_back();
    const std::string where = absl::StrCat("animation ", i);
    const uint64_t before = budget.bytes();
    uint64_t parts = 0;
    for (const char* key : {"samplers", "channels"}) {
      if (root[i].is_object()) parts += ArraySize(root[i], key);
    }
    total += parts;
    // Including the sets of those already read.
    constexpr uint64_t kPartBytes = sizeof(AnimationSampler) + sizeof(AnimationChannel) + 128;
    if (total > most) {
      out.fault = absl::ResourceExhaustedError(
          absl::StrCat("glTF: ", where, ": more animations, channels and samplers than the limit max_nodes, ", most));
    } else if (absl::Status full = budget.Take(parts, kPartBytes, where); !full.ok()) {
      out.fault = std::move(full);
    } else {
      try {
        out.fault = Reader(accessors, document.accessors.size(), scene, targets, where).Read(root[i], out);
      } catch (const Json::exception& error) {
        out.fault = absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": ", error.what()));
      }
    }
    if (!out.fault.ok()) {
      if (!IsOfFile(out.fault)) return out.fault;
      out.samplers = {};
      out.channels = {};
      budget.ShrinkTo(before);
    }
    const uint64_t kept = AnimationBytes(out) - sizeof out, taken = budget.bytes() - before;
    if (kept > taken) {
      if (absl::Status full = budget.Take(kept - taken, 1, where); !full.ok()) return full;
    } else {
      budget.ShrinkTo(before + kept);  // its input is freed
    }
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::gltf
