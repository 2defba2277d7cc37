// The formats of output files: one list, from which options, messages, completion and documents are made.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "encode/result_file.h"
#include "job/request.h"

namespace voxelpipe {

// What becomes of several targets.
enum class TargetPlaces : uint8_t {
  kTogether,  // all in one file
  kFileEach,  // OUT.0.ext, OUT.1.ext, ...
  kOne,       // the format holds one target
  kDrawn,     // the solid voxels and their colours, which several targets may give
};

struct OutputFormat {
  std::string_view name;                 // of --format; the extension without its dot: "npy", "nii.gz"
  std::string_view extension;            // with its dot, lower case
  std::string_view title;                // what it is, a few words
  bool sparse = false, buckets = false;  // holds results of this kind; all hold dense ones
  TargetPlaces targets = TargetPlaces::kTogether;
  bool standard_output = true;  // can be written front to back
  bool directory = false;       // the output is a directory
  bool colours = false;         // shows the colours of the mesh (UseDefaultsOf)
  bool labels = false;          // holds labels of parts (UseDefaultsOf)
  bool whole = false;           // the writer collects the result in memory before it writes
  // In: a path, empty for standard output, and a job, which may be null and must outlive the writer. Out: a writer
  // whose Begin creates the file. Null for pictures, which are drawn from whole results (png_preview.h).
  std::unique_ptr<ResultFile> (*open)(const std::string& path, const JobContext* job) = nullptr;
  // In: the header of a result that the format holds. Out: what of it the file does not tell, as one line for a warning
  // not_kept; empty if nothing is lost. Null: the file tells all.
  std::string (*not_kept)(const ResultHeader& header) = nullptr;
  // True for targets that the format holds, which `kept_targets` names. Null: it holds all.
  bool (*keeps)(const TargetSpec& spec) = nullptr;
  std::string_view kept_targets = {};

  bool picture() const { return open == nullptr; }
  // True if the file is made of the whole result, of which it shows the solid voxels.
  bool of_whole_results() const { return whole || picture(); }
  bool Holds(ResultKind kind) const {
    return kind == ResultKind::kDense || (kind == ResultKind::kSparse ? sparse : buckets);
  }
};

// All formats of this build, in the order in which they are named.
std::span<const OutputFormat> OutputFormats();

// What a request leaves open, for a file of this format. `open_targets`: it names neither targets nor a shader;
// `open_result`: no kind of result. A format that collects the result gets a sparse one, in which a voxel is solid
// whatever its value. One that shows colours gets base_color in sRGB, white where the mesh has none and inside a fill;
// but bits where nothing is covered. One of labels gets those of the parts in u16, 1 inside a fill of the whole mesh.
void UseDefaultsOf(const OutputFormat& format, bool open_targets, bool open_result, VoxelizeRequest& request);

// Warns of what a file of this format does not hold of a result (OutputFormat::not_kept).
void WarnOfNotKept(const OutputFormat& format, const ResultHeader& header, WarningList& warnings);

// Why this build does not have the format of an extension that others have; empty if it has it or none has.
std::string_view WhyNotBuilt(std::string_view extension);

// The format of an extension (".npy", lower case); null if there is none.
const OutputFormat* FindFormat(std::string_view extension);

// In: a file name in lower case. Out: the longest extension of a format that ends it; empty if there is none, or
// nothing stands before it.
std::string_view FormatExtensionOf(std::string_view lower_case_name);

// Names as a list for messages: "npy, npz or raw", of those that `wanted` returns true for. `dots`: extensions.
std::string ListFormats(bool dots, bool (*wanted)(const OutputFormat& format) = nullptr);
// The choices of an option: the names, and as "npy|npz|raw".
std::vector<std::string> FormatNames();
std::string FormatChoices();

// INVALID_ARGUMENT naming formats that can, if files of this extension cannot hold a result of this kind, or so many
// targets.
absl::Status CheckHolds(std::string_view extension, ResultKind kind, size_t targets);
// The same, also if the format does not hold one of these targets.
absl::Status CheckHolds(std::string_view extension, ResultKind kind, std::span<const TargetSpec> targets);

}  // namespace voxelpipe
