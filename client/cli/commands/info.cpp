#include <exception>
#include <new>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "commands/commands.h"
#include "interrupt.h"
#include "mesh/report.h"
#include "mesh_file.h"
#include "report.h"
#include "server_option.h"

namespace voxelpipe::cli {
namespace {

struct InfoArguments {
  std::string path, server;
  bool json = false;
};

// `loaded` is null where a server looked at the mesh: then its report is all there is.
nlohmann::ordered_json InfoJson(const std::string& path, const MeshReport& report, const LoadedMesh* loaded) {
  nlohmann::ordered_json json;
  json["input"] = path;
  json["triangles"] = report.triangles;
  json["vertices"] = report.vertices;
  json["degenerate_triangles"] = report.degenerate_triangles;
  json["open_edges"] = report.open_edges;
  json["min"] = {report.min.x, report.min.y, report.min.z};
  json["max"] = {report.max.x, report.max.y, report.max.z};
  if (loaded == nullptr) return json;
  json["format"] = loaded->scene.format;
  json["bytes"] = loaded->packed_bytes;
  json["nodes"] = loaded->scene.nodes.size();
  json["meshes"] = loaded->scene.meshes.size();
  json["parts"] = loaded->mesh.parts.size();
  json["materials"] = loaded->scene.materials.size();
  json["textures"] = loaded->scene.textures.size();
  json["images"] = loaded->scene.images.size();
  json["attributes"] = nlohmann::ordered_json::array();
  for (const VertexAttribute& attribute : loaded->mesh.attributes) {
    json["attributes"].push_back({{"name", attribute.name}, {"components", attribute.components}});
  }
  json["warnings"] = loaded->scene.warnings;
  json["stages"] = {{"load", loaded->load_ms}, {"flatten", loaded->flatten_ms}};
  json["peak_bytes"] = ProcessPeakBytes();
  return json;
}

std::string InfoTable(const std::string& path, const MeshReport& report, const LoadedMesh* loaded) {
  std::string table = path;
  const auto row = [&](const char* name, const std::string& text) {
    absl::StrAppend(&table, absl::StrFormat("\n  %-12s", name), text);
  };
  row("triangles",
      absl::StrCat(WithCommas(report.triangles), ", ", WithCommas(report.degenerate_triangles), " degenerate"));
  row("vertices", WithCommas(report.vertices));
  row("open edges",
      WithCommas(report.open_edges) + (report.open_edges == 0 && report.triangles > 0 ? " (closed)" : ""));
  row("box", absl::StrFormat("%.6g %.6g %.6g to %.6g %.6g %.6g", report.min.x, report.min.y, report.min.z, report.max.x,
                             report.max.y, report.max.z));
  if (loaded == nullptr) return table;
  const Scene& scene = loaded->scene;
  row("format", absl::StrCat(scene.format, ", ", HumanBytes(loaded->packed_bytes)));
  row("scene", absl::StrCat(scene.nodes.size(), " nodes, ", scene.meshes.size(), " meshes, ", loaded->mesh.parts.size(),
                            " parts, ", scene.materials.size(), " materials, ", scene.images.size(), " images"));
  const std::vector<VertexAttribute>& own = loaded->mesh.attributes;
  for (size_t i = 0; i < own.size(); ++i) {
    row(i == 0 ? "attributes" : "",
        absl::StrCat(own[i].name, ", ", own[i].components, own[i].components == 1 ? " component" : " components"));
  }
  for (size_t i = 0; i < scene.warnings.size(); ++i) row(i == 0 ? "warnings" : "", scene.warnings[i]);
  return table;
}

absl::Status Print(const InfoArguments& arguments, const MeshReport& report, const LoadedMesh* loaded) {
  if (!arguments.json) return PrintLine(InfoTable(arguments.path, report, loaded));
  // A name in the file may not be UTF-8.
  constexpr auto kReplace = nlohmann::json::error_handler_t::replace;
  return PrintLine(InfoJson(arguments.path, report, loaded).dump(-1, ' ', false, kReplace));
}

absl::Status Info(const InfoArguments& arguments) {
  JobContext job;
  const CancelOnInterrupt cancel(job);
  try {
    if (!arguments.server.empty()) {
      const absl::StatusOr<MeshReport> report = RemoteReport(arguments.server, arguments.path, job);
      return report.ok() ? Print(arguments, *report, nullptr) : report.status();
    }
    absl::StatusOr<MeshInput> mesh = ReadMeshInput(arguments.path, job);
    if (!mesh.ok()) return mesh.status();
    const absl::StatusOr<LoadedMesh> loaded = LoadMesh(*std::move(mesh), job);
    if (!loaded.ok()) return loaded.status();
    return Print(arguments, ReportMesh(loaded->mesh), &*loaded);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& error) {
    return absl::InternalError(error.what());
  }
}

}  // namespace

void AddInfoCommand(CLI::App& app, int& exit_code) {
  auto arguments = std::make_shared<InfoArguments>();
  CLI::App* command = app.add_subcommand("info", "Say what a mesh file holds");
  command->add_option("FILE", arguments->path, "Mesh file: .glb, .gltf, .drc")->required()->type_name("");
  command->add_option("--server", arguments->server, "Let this server look at it")
      ->type_name("HOST:PORT")
      ->check(RefuseEmpty);
  command->add_flag("--json", arguments->json, "Print one JSON object");
  command->callback([arguments, &exit_code] {
    if (const absl::Status status = CheckServerOption(arguments->server); !status.ok()) {
      PrintError("", status);
      exit_code = 2;
      return;
    }
    const absl::Status status = Info(*arguments);
    if (status.ok()) return;
    const int signal = InterruptSignal();
    PrintError(arguments->path, signal != 0 ? absl::CancelledError("stopped") : status);
    exit_code = signal != 0 ? 128 + signal : 1;
  });
}

}  // namespace voxelpipe::cli
