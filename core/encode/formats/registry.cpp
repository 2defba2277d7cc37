#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "encode/format_registry.h"
#include "encode/formats/writers.h"

namespace voxelpipe {
namespace {

// Appends to lines of what is lost.
void Append(std::string& lost, std::string_view what) {
  absl::StrAppend(&lost, lost.empty() ? "" : "; ", std::string(what));
}

// Of several targets that are not bits, a drawing shows one; of bits, the first.
std::string TargetsNotDrawn(const ResultHeader& header) {
  const auto bits = std::count_if(header.specs.begin(), header.specs.end(),
                                  [](const TargetSpec& spec) { return spec.format == VoxelFormat::kBit; });
  const auto others = ptrdiff_t(header.specs.size()) - bits;
  return bits > 1 || others > 1 ? "the file shows the solid voxels in one colour each, not every target" : "";
}

// That a .vox does not hold the grid's origin and voxel size is true of every one, so it is no warning.
std::string NotInVox(const ResultHeader& header) {
  constexpr int64_t kMaxDim = 2000;  // from -1000 to 999
  std::string lost;
  const auto& dims = header.grid.dims;
  if (std::any_of(dims.begin(), dims.end(), [](int64_t dim) { return dim > kMaxDim; })) {
    Append(
        lost,
        "MagicaVoxel takes voxels from -1000 to 999 along each axis: the grid, whose centre is at 0, reaches beyond");
  }
  if (const std::string targets = TargetsNotDrawn(header); !targets.empty()) Append(lost, targets);
  return lost;
}

std::string NotInBinvox(const ResultHeader& header) {
  std::string lost;
  const Vec3d& size = header.grid.voxel_size;
  if (size.x != size.y || size.x != size.z)
    Append(lost, "binvox has one voxel size for all axes: that of x is written");
  const bool values = std::any_of(header.specs.begin(), header.specs.end(),
                                  [](const TargetSpec& spec) { return spec.format != VoxelFormat::kBit; });
  if (values || header.specs.size() > 1) Append(lost, "binvox holds bits alone, of the solid voxels");
  return lost;
}

// 3D Slicer ignores the voxels of a grid of one.
std::string NotInSegNrrd(const ResultHeader& header) {
  return header.grid.voxels() > 1 ? "" : "3D Slicer takes a grid of one voxel as a segmentation without an image";
}

[[maybe_unused]] bool IsScalar(const TargetSpec& spec) {
  return spec.components == 1 && spec.encoding == Encoding::kLinear;
}

bool IsLabelmap(const TargetSpec& spec) {
  const VoxelFormat format = spec.format;
  const bool whole = format == VoxelFormat::kBit || format == VoxelFormat::kU8 || format == VoxelFormat::kU16 ||
                     format == VoxelFormat::kU32;
  return whole && spec.components == 1 && spec.encoding == Encoding::kLinear;
}

// Formats that this build could have, and how.
constexpr std::array<std::pair<std::string_view, std::string_view>, 4> kOptional = {
    {{".h5", "this build was made without HDF5 (-DVOXELPIPE_HDF5=ON)"},
     {".vdb", "this build was made without OpenVDB (-DVOXELPIPE_OPENVDB=ON); nanovdb_convert makes one of a .nvdb"},
     {".nvdb", "this build was made without NanoVDB (Debian's libnanovdb-dev)"},
     {".html", "this build was made without its viewer, which npm brings (-DVOXELPIPE_VIEWER=ON says why)"}}};

// A format whose writer collects the result first (drawn/whole_file.h).
OutputFormat Collected(OutputFormat format) {
  format.sparse = format.whole = true;
  return format;
}

// One of those that hold the solid voxels and their colours.
OutputFormat Drawn(OutputFormat format) {
  format.buckets = true;
  format.targets = TargetPlaces::kDrawn;
  format.colours = format.name != "binvox";
  return Collected(format);
}

const std::vector<OutputFormat>& List() {
  static const std::vector<OutputFormat> formats = [] {
    std::vector<OutputFormat> list;
    list.push_back({.name = "npy",
                    .extension = ".npy",
                    .title = "NumPy array",
                    .targets = TargetPlaces::kFileEach,
                    .open = &MakeNpyFile});
    list.push_back({.name = "npz",
                    .extension = ".npz",
                    .title = "NumPy arrays in an archive",
                    .sparse = true,
                    .buckets = true,
                    .open = &MakeNpzFile});
    list.push_back({.name = "raw",
                    .extension = ".raw",
                    .title = "bytes, described by OUT.raw.json",
                    .targets = TargetPlaces::kFileEach,
                    .open = &MakeRawFile});
    list.push_back({.name = "vti", .extension = ".vti", .title = "VTK image data", .open = &MakeVtiFile});
    list.push_back(
        {.name = "nrrd", .extension = ".nrrd", .title = "NRRD", .targets = TargetPlaces::kOne, .open = &MakeNrrdFile});
    list.push_back({.name = "seg.nrrd",
                    .extension = ".seg.nrrd",
                    .title = "segmentation of 3D Slicer",
                    .targets = TargetPlaces::kOne,
                    .labels = true,
                    .open = &MakeSegNrrdFile,
                    .not_kept = &NotInSegNrrd,
                    .keeps = &IsLabelmap,
                    .kept_targets = "bits, or u8, u16 or u32 of one component"});
    list.push_back({.name = "nii.gz",
                    .extension = ".nii.gz",
                    .title = "NIfTI",
                    .targets = TargetPlaces::kOne,
                    .open = &MakeNiftiFile});
    list.push_back({.name = "zarr",
                    .extension = ".zarr",
                    .title = "OME-Zarr",
                    .standard_output = false,
                    .directory = true,
                    .open = &MakeZarrDirectory});
    list.push_back(
        Collected({.name = "ply", .extension = ".ply", .title = "points", .buckets = true, .open = &MakePlyFile}));
    list.push_back(Drawn({.name = "glb",
                          .extension = ".glb",
                          .title = "surface as glTF",
                          .open = &MakeGlbFile,
                          .not_kept = &TargetsNotDrawn}));
    list.push_back(Drawn({.name = "merged.glb",
                          .extension = ".merged.glb",
                          .title = "surface as glTF, faces merged",
                          .open = &MakeMergedGlbFile,
                          .not_kept = &TargetsNotDrawn}));
    list.push_back(Drawn(
        {.name = "vox", .extension = ".vox", .title = "MagicaVoxel", .open = &MakeVoxFile, .not_kept = &NotInVox}));
    list.push_back(Drawn({.name = "binvox",
                          .extension = ".binvox",
                          .title = "binvox",
                          .open = &MakeBinvoxFile,
                          .not_kept = &NotInBinvox}));
#ifdef VOXELPIPE_HAVE_HDF5
    list.push_back({.name = "h5",
                    .extension = ".h5",
                    .title = "HDF5 of materials, as gprMax and Meep read it",
                    .targets = TargetPlaces::kOne,
                    .open = &MakeH5File,
                    .keeps = &IsScalar,
                    .kept_targets = "one number a voxel"});
#endif
#ifdef VOXELPIPE_HAVE_NANOVDB
    list.push_back(Collected({.name = "nvdb", .extension = ".nvdb", .title = "NanoVDB", .open = &MakeNvdbFile}));
#endif
#ifdef VOXELPIPE_HAVE_OPENVDB
    list.push_back(Collected({.name = "vdb", .extension = ".vdb", .title = "OpenVDB", .open = &MakeVdbFile}));
#endif
#ifdef VOXELPIPE_HAVE_VIEWER
    list.push_back(Collected(
        {.name = "html", .extension = ".html", .title = "page with a viewer", .colours = true, .open = &MakeHtmlFile}));
#endif
    list.push_back(
        {.name = "png", .extension = ".png", .title = "picture", .sparse = true, .buckets = true, .colours = true});
    return list;
  }();
  return formats;
}

// "a, b or c".
std::string Joined(const std::vector<std::string_view>& words) {
  std::string text;
  for (size_t i = 0; i < words.size(); ++i) {
    absl::StrAppend(&text, i == 0 ? "" : i + 1 < words.size() ? ", " : " or ", std::string(words[i]));
  }
  return text;
}

}  // namespace

std::span<const OutputFormat> OutputFormats() {
  return List();
}

void UseDefaultsOf(const OutputFormat& format, bool open_targets, bool open_result, VoxelizeRequest& request) {
  if (open_result && format.of_whole_results()) request.result = ResultKind::kSparse;
  if (!open_targets) return;
  if (format.labels) {
    request.targets.assign(1, TargetSpec{});
    TargetSpec& target = request.targets.front();
    target.format = VoxelFormat::kU16;
    target.blend = Blend::kReplace;
    target.shader = {"label", {}};
    // Parts fill with their own labels.
    if (request.parts.scope == PartScope::kWhole && request.fill != Fill::kNone) target.fill_values = {1};
    return;
  }
  if (!format.colours || request.coverage == Coverage::kNone) return;
  request.targets.assign(1, TargetSpec{});
  TargetSpec& target = request.targets.front();
  target.format = VoxelFormat::kU8;
  target.encoding = Encoding::kSrgb;
  target.components = 4;
  target.blend = Blend::kReplace;
  target.shader = {"base_color", {}};
  if (request.fill != Fill::kNone) target.fill_values = {255};
}

void WarnOfNotKept(const OutputFormat& format, const ResultHeader& header, WarningList& warnings) {
  if (format.not_kept == nullptr) return;
  const std::string lost = format.not_kept(header);
  if (!lost.empty()) warnings.Add(WarningCode::kNotKept, format.extension, lost);
}

std::string_view WhyNotBuilt(std::string_view extension) {
  const auto* const found = std::find_if(kOptional.begin(), kOptional.end(),
                                         [&](const auto& optional) { return optional.first == extension; });
  return found == kOptional.end() || FindFormat(extension) != nullptr ? "" : found->second;
}

const OutputFormat* FindFormat(std::string_view extension) {
  const auto& list = List();
  const auto found = std::find_if(list.begin(), list.end(), [&](const auto& f) { return f.extension == extension; });
  return found == list.end() ? nullptr : &*found;
}

std::string_view FormatExtensionOf(std::string_view name) {
  std::string_view longest;
  for (const OutputFormat& format : List()) {
    const bool ends = name.size() > format.extension.size() && name.ends_with(format.extension);
    if (ends && format.extension.size() > longest.size()) longest = format.extension;
  }
  return longest;
}

std::string ListFormats(bool dots, bool (*wanted)(const OutputFormat& format)) {
  std::vector<std::string_view> names;
  for (const OutputFormat& format : List()) {
    if (wanted == nullptr || wanted(format)) names.push_back(dots ? format.extension : format.name);
  }
  return Joined(names);
}

std::vector<std::string> FormatNames() {
  std::vector<std::string> names;
  for (const OutputFormat& format : List()) names.emplace_back(format.name);
  return names;
}

std::string FormatChoices() {
  return absl::StrJoin(FormatNames(), "|");
}

absl::Status CheckHolds(std::string_view extension, ResultKind kind, size_t targets) {
  const OutputFormat* const format = FindFormat(extension);
  const std::string shown(extension);
  if (format == nullptr) {
    const std::string why(WhyNotBuilt(extension));
    return absl::InvalidArgumentError(absl::StrCat("no writer for '", shown, "'", why.empty() ? "" : ": ", why,
                                                   "; known extensions are ", ListFormats(true)));
  }
  std::vector<std::string_view> others;
  const bool holds = format->Holds(kind);
  for (const OutputFormat& other : List()) {
    if (other.picture() || !other.Holds(kind)) continue;
    if (!holds || other.targets == TargetPlaces::kTogether) others.push_back(other.extension);
  }
  if (!holds) {
    return absl::InvalidArgumentError(absl::StrCat(shown, " holds ", format->sparse ? "dense and sparse" : "dense",
                                                   " results; a ", std::string(Name(kind)), " one goes into ",
                                                   Joined(others)));
  }
  if (targets == 1 || format->targets != TargetPlaces::kOne) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(shown, " holds one target; ", targets, " targets go into ", Joined(others)));
}

absl::Status CheckHolds(std::string_view extension, ResultKind kind, std::span<const TargetSpec> targets) {
  if (absl::Status s = CheckHolds(extension, kind, targets.size()); !s.ok()) return s;
  const OutputFormat& format = *FindFormat(extension);
  if (format.keeps == nullptr) return absl::OkStatus();
  const auto lost = std::find_if_not(targets.begin(), targets.end(), format.keeps);
  if (lost == targets.end()) return absl::OkStatus();
  std::vector<std::string_view> others;
  for (const OutputFormat& other : List()) {
    if (!other.picture() && other.Holds(kind) && other.keeps == nullptr) others.push_back(other.extension);
  }
  return absl::InvalidArgumentError(
      absl::StrCat(std::string(extension), " holds ", std::string(format.kept_targets), "; a target of ",
                   std::string(Name(lost->format)), lost->components > 1 ? absl::StrCat("x", lost->components) : "",
                   lost->encoding == Encoding::kLinear ? "" : absl::StrCat(" in ", std::string(Name(lost->encoding))),
                   " goes into ", Joined(others)));
}

}  // namespace voxelpipe
