// Texts of shaders, targets and options, right and wrong, with what they mean: the same table as client/python reads.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "request_text/request_options.h"
#include "request_text/shader_text.h"
#include "request_text/target_text.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

using nlohmann::json;

// JSON has no infinities: the table writes them as texts.
json NumberJson(double number) {
  if (std::isinf(number)) return number < 0 ? "-inf" : "inf";
  return number;
}

json NumbersJson(const std::vector<double>& numbers) {
  json list = json::array();
  for (const double number : numbers) list.push_back(NumberJson(number));
  return list;
}

json ShaderJson(const ShaderCall& shader) {
  json object{{"name", shader.name}};
  for (const auto& [name, values] : shader.parameters) object["parameters"][name] = NumbersJson(values);
  for (const auto& [name, text] : shader.text) object["parameters"][name] = text;
  return object;
}

// The fields that `expected` names, and those that differ from a target's defaults.
json TargetJson(const TargetSpec& target, const json& expected) {
  const TargetSpec defaults;
  json object{{"format", Name(target.format)},
              {"components", target.components},
              {"blend", Name(target.blend)},
              {"shader", ShaderJson(target.shader)}};
  const auto add = [&](const char* name, bool differs, const json& value) {
    if (differs || expected.contains(name)) object[name] = value;
  };
  add("encoding", target.encoding != defaults.encoding, Name(target.encoding));
  add("clear", target.clear != defaults.clear, NumberJson(target.clear));
  add("scale", target.scale != defaults.scale, target.scale ? NumberJson(*target.scale) : json());
  add("quantum", target.quantum != defaults.quantum, NumberJson(target.quantum));
  add("fill", target.fill_values != defaults.fill_values, NumbersJson(target.fill_values));
  return object;
}

json Vec3Json(const Vec3d& v) {
  return {v.x, v.y, v.z};
}

json RulesJson(const std::vector<PartRule>& rules) {
  json list = json::array();
  for (const PartRule& rule : rules) list.push_back({rule.pattern, rule.number});
  return list;
}

json PartsJson(const PartSelection& parts) {
  return {{"scope", Name(parts.scope)},
          {"labels", RulesJson(parts.labels)},
          {"priorities", RulesJson(parts.priorities)},
          {"exclude", parts.exclude}};
}

// One text or a list of them.
void TakeTexts(const json& given, const char* name, std::vector<std::string>& texts) {
  if (!given.contains(name)) return;
  if (given[name].is_string()) {
    texts = {given[name].get<std::string>()};
  } else {
    texts = given[name].get<std::vector<std::string>>();
  }
}

// What the options of parts, axes and clip make of a request: its parts if they are named; else the grid if it is
// given, else its vertex shader.
absl::StatusOr<json> RequestJson(const json& given) {
  RequestOptions options;
  const auto take = [&]<typename T>(const char* name, std::optional<T>& value) {
    if (given.contains(name)) value = given[name].get<T>();
  };
  take("resolution", options.resolution);
  take("voxel_size", options.voxel_size);
  take("dims", options.dims);
  take("origin", options.origin);
  take("fit", options.fit);
  take("axes", options.axes);
  take("clip", options.clip);
  take("vertex_shader", options.vertex_shader);
  options.padding = given.value("padding", 0);
  options.parts = given.value("parts", "whole");
  TakeTexts(given, "part_label", options.part_labels);
  TakeTexts(given, "part_priority", options.part_priorities);
  TakeTexts(given, "exclude", options.exclude);
  const absl::StatusOr<VoxelizeRequest> request = BuildRequest(options, OptionNames::kKeys);
  if (!request.ok()) return request.status();
  if (given.contains("parts")) return json{{"parts", PartsJson(request->parts)}};
  if (!request->grid.given()) return json{{"vertex_shader", ShaderJson(request->vertex_shader)}};
  return json{{"grid",
               {{"dims", *request->grid.dims},
                {"origin", Vec3Json(*request->grid.origin)},
                {"voxel_size", Vec3Json(*request->grid.voxel_size)}}}};
}

absl::StatusOr<json> Parsed(const json& one) {
  if (one.contains("options")) return RequestJson(one["options"]);
  if (one.contains("shader")) {
    const absl::StatusOr<ShaderCall> shader = ParseShaderCall(one["shader"].get<std::string>());
    if (!shader.ok()) return shader.status();
    return ShaderJson(*shader);
  }
  const absl::StatusOr<ShaderCall> shader = ParseShaderCall(one.value("default_shader", "occupancy"));
  if (!shader.ok()) return shader.status();
  const absl::StatusOr<TargetSpec> target = ParseTarget(one["target"].get<std::string>(), *shader);
  if (!target.ok()) return target.status();
  json object = TargetJson(*target, one.value("is", json::object()));
  // The table leaves open components open: the shader's own then.
  if (one.contains("is") && one["is"]["components"].is_null() && target->components == OwnComponents(*target)) {
    object["components"] = nullptr;
  }
  return object;
}

TEST(RequestCases, MeanWhatTheTableSays) {
  const json cases = json::parse(std::ifstream(VOXELPIPE_REQUEST_CASES));
  ASSERT_GE(cases.size(), 150u);
  for (const json& one : cases) {
    const absl::StatusOr<json> parsed = Parsed(one);
    if (one.contains("error")) {
      EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument) << one;
      EXPECT_EQ(std::string(parsed.status().message()), one["error"].get<std::string>());
    } else {
      ASSERT_TRUE(parsed.ok()) << one << parsed.status();
      EXPECT_EQ(*parsed, one["is"]) << one;
    }
  }
}

}  // namespace
}  // namespace voxelpipe
