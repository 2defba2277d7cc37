#include "options/output_plan.h"

#include <filesystem>
#include <map>

#include "absl/strings/str_cat.h"
#include "encode/encode.h"
#include "encode/format_registry.h"
#include "options/standard_streams.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;

bool NamesDirectory(const std::string& path) {
  if (path.back() == '/') return true;
  const OutputFormat* const format = FindFormat(FileExtension(path));
  if (format != nullptr && format->directory) return false;  // an earlier result
  std::error_code error;  // an unreadable path counts as no directory; writing reports the error
  return fs::is_directory(path, error);
}

template <typename... Parts>
absl::Status Wrong(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat(parts...));
}

// ".npz" of the files whose names give no extension.
std::string UsualExtension(const OutputNames& names, ResultKind kind) {
  if (!names.format.empty()) return absl::StrCat(".", names.format);
  return kind == ResultKind::kDense ? ".npy" : ".npz";
}

bool GoesToStandardOutput(const OutputFormat& format) {
  return format.standard_output;
}

absl::Status CheckStandardOutputPlan(const OutputNames& names, const InputList& inputs, size_t targets) {
  if (names.format.empty()) {
    return Wrong("--output: '-' is standard output; name its format by --format ",
                 ListFormats(false, &GoesToStandardOutput));
  }
  const OutputFormat* const format = FindFormat(absl::StrCat(".", names.format));
  if (format == nullptr || !format->standard_output) {
    return Wrong("--output: '-' cannot take the format ", names.format, "; give a file name, or --format ",
                 ListFormats(false, &GoesToStandardOutput));
  }
  if (inputs.files.size() != 1 || inputs.open_ended) {
    return Wrong("--output: '-' takes the result of one file, not of a list; give a directory");
  }
  if (targets == 1 || format->targets != TargetPlaces::kFileEach) return absl::OkStatus();
  return Wrong("--output: ", targets, " targets are ", targets, " .", names.format,
               " files, which '-' cannot take; give --format npz or a file name");
}

// The file or directory of one option, with its place in a plan.
struct Place {
  const char* option;
  const std::string& path;
  const std::string extension;  // of files in a directory
  std::string OutputPlan::*member;
};

absl::Status PlanPlace(const Place& place, const InputList& inputs, std::vector<OutputPlan>& plans) {
  const auto& [option, path, extension, member] = place;
  if (path.empty()) return absl::OkStatus();
  const bool picture = member == &OutputPlan::preview;
  const bool directory = NamesDirectory(path);
  const std::string given = FileExtension(path);
  const bool list = inputs.files.size() > 1 || inputs.open_ended;
  if (list && !directory && IsKnownExtension(given)) {
    return Wrong(option, ": '", path, "' names one file, but there ",
                 inputs.open_ended ? "is a directory or pattern among the inputs"
                                   : absl::StrCat("are ", inputs.files.size(), " inputs"),
                 "; give a directory");
  }
  if (directory || list) {
    for (size_t i = 0; i < plans.size(); ++i) {
      plans[i].*member = (fs::path(path) / (inputs.files[i].name + extension)).string();
    }
    return absl::OkStatus();
  }
  if (!IsKnownExtension(given) || (picture && given != ".png")) {
    const std::string why(WhyNotBuilt(given));
    return Wrong(option, ": '", path, "': ", why, why.empty() ? "" : "; ", "the extension must be ",
                 picture ? ".png" : ListFormats(true), given.empty() ? ", but there is none" : "");
  }
  plans[0].*member = path;
  return absl::OkStatus();
}

// Each file is written once, and none is an input.
absl::Status CheckDistinct(const InputList& inputs, const std::vector<OutputPlan>& plans) {
  std::map<std::string, size_t> input_of;
  for (size_t i = 0; i < plans.size(); ++i) {
    for (const std::string& path : {plans[i].result, plans[i].preview}) {
      if (path.empty()) continue;
      std::error_code none;  // most outputs do not exist yet
      if (fs::equivalent(path, inputs.files[i].path, none)) {
        return Wrong("--output: '", path, "' is the mesh itself; give another name");
      }
      const auto [taken, fresh] = input_of.emplace(path, i);
      if (fresh) continue;
      if (taken->second == i)
        return Wrong("--preview: '", path, "' is the file of --output already; give another name");
      return Wrong("'", inputs.files[taken->second].path, "' and '", inputs.files[i].path, "' would both become '",
                   path, "'; run them apart, or name their common directory, which keeps folders apart");
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::vector<OutputPlan>> PlanOutputs(const InputList& inputs, const OutputNames& names,
                                                    const VoxelizeRequest& request) {
  std::vector<OutputPlan> plans(inputs.files.size());
  if (!names.format.empty() && names.output.empty()) {
    return Wrong("--format: is that of --output, which is not given");
  }
  const std::string usual = UsualExtension(names, request.result);
  if (IsStandardStream(names.output)) {
    if (absl::Status s = CheckStandardOutputPlan(names, inputs, request.targets.size()); !s.ok()) return s;
    plans[0].standard_output = usual;
  } else {
    absl::Status s = PlanPlace({"--output", names.output, usual, &OutputPlan::result}, inputs, plans);
    if (!s.ok()) return s;
  }
  absl::Status s = PlanPlace({"--preview", names.preview, ".png", &OutputPlan::preview}, inputs, plans);
  if (!s.ok()) return s;
  for (const OutputPlan& plan : plans) {
    if (plan.result.empty() && plan.standard_output.empty()) continue;
    const std::string extension = plan.result.empty() ? plan.standard_output : FileExtension(plan.result);
    if (const absl::Status holds = CheckHolds(extension, request.result, request.targets); !holds.ok()) {
      return Wrong("--output: ", std::string(holds.message()));
    }
    if (!names.format.empty() && extension != usual) {
      return Wrong("--format: '", plan.result, "' is no ", names.format, "; leave --format out, or change the name");
    }
  }
  if (absl::Status distinct = CheckDistinct(inputs, plans); !distinct.ok()) return distinct;
  if (names.view.empty()) return plans;
  const absl::StatusOr<PreviewView> camera = ParseView(names.view);
  if (!camera.ok()) return Wrong("--view: ", std::string(camera.status().message()));
  for (OutputPlan& plan : plans) {
    if (plan.preview.empty() && FileExtension(plan.result) != ".png" && plan.standard_output != ".png") {
      return Wrong("--view: there is no picture; give --preview or -o OUT.png");
    }
    plan.view = *camera;
  }
  return plans;
}

}  // namespace voxelpipe::cli
