#include "options/output_plan.h"

#include <filesystem>
#include <set>

#include "absl/strings/str_cat.h"
#include "encode/encode.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;

bool NamesDirectory(const std::string& path) {
  std::error_code error;  // an unreadable path counts as no directory; writing reports the error
  return path.back() == '/' || fs::is_directory(path, error);
}

std::vector<std::string> UniqueStems(const std::vector<std::string>& inputs) {
  std::set<std::string> taken;
  std::vector<std::string> stems;
  for (const std::string& input : inputs) {
    std::string stem = fs::path(input).stem().string();
    if (stem.empty()) stem = "mesh";
    std::string name = stem;
    for (int number = 2; !taken.insert(name).second; ++number) name = absl::StrCat(stem, "-", number);
    stems.push_back(name);
  }
  return stems;
}

}  // namespace

absl::StatusOr<std::vector<OutputPlan>> PlanOutputs(const std::vector<std::string>& inputs, const std::string& output,
                                                    const std::string& preview, ResultKind kind) {
  std::vector<OutputPlan> plans(inputs.size());
  const std::vector<std::string> stems = UniqueStems(inputs);
  const auto plan = [&](const char* option, const std::string& path, const char* extension, bool picture,
                        std::string OutputPlan::*member) -> absl::Status {
    if (path.empty()) return absl::OkStatus();
    const bool directory = NamesDirectory(path);
    const std::string given = FileExtension(path);
    if (inputs.size() > 1 && !directory && IsKnownExtension(given)) {
      return absl::InvalidArgumentError(absl::StrCat(option, ": '", path, "' names one file, but there are ",
                                                     inputs.size(), " inputs; give a directory"));
    }
    if (directory || inputs.size() > 1) {
      for (size_t i = 0; i < inputs.size(); ++i) plans[i].*member = (fs::path(path) / (stems[i] + extension)).string();
      return absl::OkStatus();
    }
    if (!IsKnownExtension(given) || (picture && given != ".png")) {
      return absl::InvalidArgumentError(absl::StrCat(option, ": '", path, "': the extension must be ",
                                                     picture ? ".png" : ".npy, .npz, .raw or .png",
                                                     given.empty() ? ", but there is none" : ""));
    }
    plans[0].*member = path;
    return absl::OkStatus();
  };
  if (absl::Status s =
          plan("--output", output, kind == ResultKind::kDense ? ".npy" : ".npz", false, &OutputPlan::result);
      !s.ok())
    return s;
  if (absl::Status s = plan("--preview", preview, ".png", true, &OutputPlan::preview); !s.ok()) return s;
  return plans;
}

}  // namespace voxelpipe::cli
