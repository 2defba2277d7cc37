#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "commands/commands.h"
#include "engine/engine.h"
#include "engine/report.h"
#include "engine/server_option.h"

namespace voxelpipe::cli {
namespace {

const char* StageName(ShaderStage stage) {
  return stage == ShaderStage::kVertex ? "vertex" : "fragment";
}

nlohmann::ordered_json ShadersJson(const std::vector<ShaderInfo>& shaders) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ShaderInfo& shader : shaders) {
    nlohmann::ordered_json parameters = nlohmann::ordered_json::array();
    for (const ShaderParameterInfo& parameter : shader.parameters) {
      parameters.push_back({{"name", parameter.name},
                            {"type", parameter.type},
                            {"default", parameter.default_value},
                            {"description", parameter.description}});
    }
    list.push_back({{"name", shader.name},
                    {"stage", StageName(shader.stage)},
                    {"description", shader.description},
                    {"output_type", shader.output_type},
                    {"output_components", shader.output_components},
                    {"reads_textures", shader.reads_textures},
                    {"parameters", parameters}});
  }
  return {{"shaders", list}};
}

// Numbers in command-line form.
std::string Typed(const std::vector<double>& values) {
  std::string text;
  for (const double value : values) absl::StrAppend(&text, text.empty() ? "" : "/", value);
  return text;
}

Lines ShadersTable(const std::vector<ShaderInfo>& shaders) {
  Lines table;
  for (const ShaderStage stage : {ShaderStage::kVertex, ShaderStage::kFragment}) {
    table.push_back(absl::StrCat(StageName(stage), " shaders:"));
    for (const ShaderInfo& shader : shaders) {
      if (shader.stage != stage) continue;
      std::string gives = shader.output_type;
      if (shader.output_components > 1) absl::StrAppend(&gives, "x", shader.output_components);
      table.push_back(absl::StrCat(absl::StrFormat("  %-18s %-9s ", shader.name, gives), shader.description));
      for (const ShaderParameterInfo& parameter : shader.parameters) {
        table.push_back(absl::StrCat("      ", parameter.name, "=", Typed(parameter.default_value), "  ",
                                     parameter.type, ": ", parameter.description));
      }
    }
  }
  return table;
}

struct ShadersArguments {
  std::string server;
  bool json = false;
};

int Shaders(const ShadersArguments& arguments) {
  const absl::StatusOr<std::unique_ptr<Engine>> engine = MakeEngine(arguments.server);
  if (!engine.ok()) {
    PrintError("", engine.status());
    return 2;
  }
  const absl::StatusOr<std::vector<ShaderInfo>> shaders = (*engine)->Shaders();
  absl::Status status = shaders.status();
  if (status.ok()) {
    status = arguments.json ? PrintLine(JsonText(ShadersJson(*shaders))) : PrintLines(ShadersTable(*shaders));
  }
  if (!status.ok()) PrintError(arguments.server, status);
  return status.ok() ? 0 : 1;
}

}  // namespace

void AddShadersCommand(Command& app, int& exit_code) {
  auto arguments = std::make_shared<ShadersArguments>();
  Command command = app.AddCommand("shaders", "List the shaders and their parameters");
  command.AddFlag("--json", arguments->json, "Print one JSON object");
  command.AddOption("--server", arguments->server, "List the shaders of this server")
      .Type("HOST:PORT")
      .Check(RefuseEmpty);
  command.SetCallback([arguments, &exit_code] { exit_code = Shaders(*arguments); });
}

}  // namespace voxelpipe::cli
