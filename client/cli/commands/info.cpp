#include <exception>
#include <new>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "commands/commands.h"
#include "engine/engine.h"
#include "engine/health_report.h"
#include "engine/interrupt.h"
#include "engine/report.h"
#include "engine/server_option.h"
#include "load/decode/image.h"
#include "mesh/contents.h"
#include "mesh/health/health.h"
#include "mesh/report.h"
#include "options/input_list.h"
#include "options/mesh_flags.h"
#include "options/missing_file.h"
#include "options/request_flags.h"
#include "options/standard_streams.h"
#include "pipeline/warnings.h"

namespace voxelpipe::cli {
namespace {

struct InfoArguments {
  std::vector<std::string> inputs;
  std::string server;
  bool recursive = false, json = false;
  MeshFlags mesh;
};

nlohmann::ordered_json InfoJson(const std::string& path, const MeshFacts& facts) {
  const MeshReport& report = facts.report;
  const MeshContents& contents = facts.contents;
  nlohmann::ordered_json json;
  json["input"] = path;
  json["triangles"] = report.triangles;
  json["vertices"] = report.vertices;
  json["degenerate_triangles"] = report.degenerate_triangles;
  json["open_edges"] = report.open_edges;
  json["min"] = {report.min.x, report.min.y, report.min.z};
  json["max"] = {report.max.x, report.max.y, report.max.z};
  const Vec3d size = report.max - report.min;
  json["size"] = {size.x, size.y, size.z};
  json["format"] = contents.format;
  json["unit"] = contents.unit.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(contents.unit);
  json["bytes"] = contents.file_bytes;
  json["nodes"] = contents.nodes;
  json["meshes"] = contents.meshes;
  json["parts"] = contents.parts;
  json["materials"] = contents.materials;
  json["textures"] = contents.textures;
  json["images"] = contents.images;
  json["attributes"] = nlohmann::ordered_json::array();
  for (const MeshContents::Attribute& attribute : contents.attributes) {
    json["attributes"].push_back({{"name", attribute.name}, {"components", attribute.components}});
  }
  json["health"] = facts.health ? HealthJson(*facts.health, path) : nlohmann::ordered_json(nullptr);
  AddWarnings(facts.warnings, json);
  json["stages"] = nlohmann::ordered_json::object();
  for (const auto& [stage, ms] : facts.stages) json["stages"][stage] = ms;
  json["peak_bytes"] = ProcessPeakBytes();
  return json;
}

// glTF's is part of its format.
std::string UnitText(const MeshContents& contents) {
  if (contents.unit.empty()) return "no unit; --unit mm|cm|m|in scales the file to metres";
  return contents.unit == "m" ? "m" : absl::StrCat(contents.unit, ", scaled to metres");
}

Lines InfoTable(const std::string& path, const MeshFacts& facts) {
  const MeshReport& report = facts.report;
  const MeshContents& contents = facts.contents;
  Lines table = {path};
  const auto row = [&](const char* name, const std::string& text) { table.push_back(TableRow(name, text)); };
  row("triangles",
      absl::StrCat(WithCommas(report.triangles), ", ", WithCommas(report.degenerate_triangles), " degenerate"));
  row("vertices", WithCommas(report.vertices));
  row("open edges",
      WithCommas(report.open_edges) + (report.open_edges == 0 && report.triangles > 0 ? " (closed)" : ""));
  row("box", absl::StrFormat("%.10g %.10g %.10g to %.10g %.10g %.10g", report.min.x, report.min.y, report.min.z,
                             report.max.x, report.max.y, report.max.z));
  const Vec3d size = report.max - report.min;
  row("size", absl::StrFormat("%.6g x %.6g x %.6g%s", size.x, size.y, size.z, contents.unit.empty() ? "" : " metres"));
  row("unit", UnitText(contents));
  if (facts.health) {
    for (const auto& [name, text] : HealthRows(*facts.health, path)) row(name.c_str(), text);
  }
  row("format", absl::StrCat(contents.format, ", ", HumanBytes(contents.file_bytes)));
  row("scene", absl::StrCat(contents.nodes, " nodes, ", contents.meshes, " meshes, ", contents.parts, " parts, ",
                            contents.materials, " materials, ", contents.images, " images"));
  const std::vector<MeshContents::Attribute>& own = contents.attributes;
  for (size_t i = 0; i < own.size(); ++i) {
    row(i == 0 ? "attributes" : "",
        absl::StrCat(own[i].name, ", ", own[i].components, own[i].components == 1 ? " component" : " components"));
  }
  const std::vector<Warning>& warnings = facts.warnings.kept();
  for (size_t i = 0; i < warnings.size(); ++i) row(i == 0 ? "warnings" : "", warnings[i].Line());
  if (facts.warnings.left_out() > 0) row("", absl::StrCat("and ", facts.warnings.left_out(), " more"));
  return table;
}

absl::Status Print(const std::string& path, const MeshFacts& facts, bool json) {
  return json ? PrintLine(JsonText(InfoJson(path, facts))) : PrintLines(InfoTable(path, facts));
}

absl::StatusOr<MeshFacts> LocalFacts(const std::string& path, const MeshReading& reading, const JobContext& job) {
  absl::StatusOr<MeshInput> mesh = ReadMeshInput(path, reading, job);
  if (!mesh.ok()) return mesh.status();
  WarningList warnings = std::move(mesh->warnings);
  absl::StatusOr<LoadedMesh> loaded = LoadMeshInput(*std::move(mesh), TextureUse{}, job);
  if (!loaded.ok()) return loaded.status();
  CheckImages(loaded->mesh);
  warnings.Append(AllWarningsOf(loaded->mesh));
  const absl::StatusOr<MeshHealth> health = CheckHealth(job, loaded->mesh);
  if (!health.ok()) return health.status();
  absl::StatusOr<MeshReport> report = BoxReport(job, loaded->mesh);
  if (!report.ok()) return report.status();
  report->degenerate_triangles = health->degenerate_triangles;
  report->open_edges = health->edges.open;
  return MeshFacts{*report,
                   std::move(loaded->contents),
                   std::move(warnings),
                   {{"load", loaded->load_ms}, {"flatten", loaded->flatten_ms}},
                   *health};
}

absl::Status InfoOf(const std::string& path, const InfoArguments& arguments) {
  JobContext job;
  const CancelOnInterrupt cancel(job);
  try {
    const absl::StatusOr<MeshFileType> type = MeshTypeOf(arguments.mesh.input_format, arguments.mesh.unit);
    if (!type.ok()) return type.status();
    // Textures are not read, but reported.
    const MeshReading reading{{arguments.mesh.allow_outside, TextureUse{}}, *type};
    const absl::StatusOr<MeshFacts> facts =
        arguments.server.empty() ? LocalFacts(path, reading, job) : RemoteFacts(arguments.server, path, reading, job);
    if (absl::IsNotFound(facts.status())) {
      return absl::NotFoundError(absl::StrCat(std::string(facts.status().message()), MissingFileHint(path)));
    }
    return facts.ok() ? Print(path, *facts, arguments.json) : facts.status();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& error) {
    return absl::InternalError(error.what());
  }
}

// Out: the exit code. Goes on after a file that cannot be described.
int Info(const InfoArguments& arguments) {
  const auto wrong_option = [](const absl::Status& status) {
    PrintError("", status);
    return 2;
  };
  if (const absl::Status status = CheckServerOption(arguments.server); !status.ok()) return wrong_option(status);
  const absl::StatusOr<InputList> inputs = ExpandInputs(arguments.inputs, arguments.recursive);
  if (!inputs.ok()) return wrong_option(inputs.status());
  if (absl::Status s = CheckInputStream(arguments.inputs); !s.ok()) return wrong_option(s);
  int exit_code = 0;
  for (const InputFile& input : inputs->files) {
    const absl::Status status = InfoOf(input.path, arguments);
    if (const int signal = InterruptSignal(); signal != 0) {
      PrintError(InputName(input.path), absl::CancelledError(StoppedReason(signal)));
      return StoppedExitCode(signal);
    }
    if (status.ok()) continue;
    PrintError(InputName(input.path), status);
    exit_code = 1;
  }
  return exit_code;
}

}  // namespace

void AddInfoCommand(Command& app, int& exit_code) {
  auto arguments = std::make_shared<InfoArguments>();
  Command command = app.AddCommand("info", "Describe mesh files: contents, health, and the fill that suits them");
  command
      .AddOption("IN", arguments->inputs,
                 Wrapped("Mesh files: .glb, .gltf, .drc, .stl, .ply, .off, .obj, .3mf; - is standard input. Also "
                         "directories and patterns, as of voxelize"))
      .Required()
      .Type("");
  command.AddFlag("--recursive", arguments->recursive, "Also the meshes in the directories below those of IN");
  command
      .AddOption("--server", arguments->server,
                 "Let this server inspect the files; the health is checked without it only")
      .Type("HOST:PORT")
      .Check(RefuseEmpty);
  command.AddFlag("--json", arguments->json, "Print one JSON object a file, one a line");
  AddMeshFlags(command, arguments->mesh);
  command.SetCallback([arguments, &exit_code] { exit_code = Info(*arguments); });
}

}  // namespace voxelpipe::cli
