#include "encode/format_registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "encode/encode.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using testing::AddBits;
using testing::AddFloats;
using testing::AddHostileParts;
using testing::AddLabels;
using testing::EmptyResult;
using ::testing::HasSubstr;
using testing::ReadFile;
using testing::SampleBit;
using testing::SampleValue;
using testing::TemporaryDirectory;

TEST(FormatRegistry, HasEachNameOnce) {
  std::set<std::string_view> names;
  for (const OutputFormat& format : OutputFormats()) {
    EXPECT_TRUE(names.insert(format.name).second) << format.name;
    EXPECT_EQ(format.extension, "." + std::string(format.name));
    EXPECT_EQ(FindFormat(format.extension), &format);
    EXPECT_FALSE(format.title.empty());
  }
  EXPECT_TRUE(names.contains("npy"));
  EXPECT_EQ(FindFormat("npy"), nullptr);
  EXPECT_EQ(FormatNames().size(), names.size());
}

// The server charges the memory of results by this.
TEST(FormatRegistry, FormatsThatCollectTheResultSaySo) {
  const std::set<std::string_view> collect = {"ply", "glb", "merged.glb", "vox", "binvox", "nvdb", "vdb", "html"};
  for (const OutputFormat& format : OutputFormats()) {
    EXPECT_EQ(format.whole, collect.contains(format.name)) << format.name;
  }
}

TEST(FormatRegistry, TheLongestExtensionOfANameWins) {
  EXPECT_EQ(FileExtension("d.npy/A.NII.GZ"), ".nii.gz");
  EXPECT_EQ(FileExtension("a.npy.gz"), ".gz");
  EXPECT_EQ(FileExtension("a.b.npz"), ".npz");
  EXPECT_EQ(FileExtension("a.SEG.nrrd"), ".seg.nrrd");
  EXPECT_EQ(FileExtension("seg.nrrd"), ".nrrd");
  EXPECT_EQ(FormatExtensionOf(".npz"), "") << "a hidden file without an extension";
  EXPECT_EQ(OutputPaths("a.nii.gz", 1), std::vector<std::string>{"a.nii.gz"});
}

TEST(FormatRegistry, NamesFormatsThatHoldWhatAnotherCannot) {
  EXPECT_TRUE(CheckHolds(".npz", ResultKind::kBuckets, 8).ok());
  EXPECT_TRUE(CheckHolds(".npy", ResultKind::kDense, 8).ok());
  const auto message = [](std::string_view extension, ResultKind kind, size_t targets) {
    const absl::Status status = CheckHolds(extension, kind, targets);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(status.message());
  };
  EXPECT_THAT(message(".npy", ResultKind::kSparse, 1),
              HasSubstr(".npy holds dense results; a sparse one goes into .npz"));
  EXPECT_THAT(message(".nrrd", ResultKind::kDense, 2), HasSubstr("one target; 2 targets go into .npz, .vti"));
  EXPECT_THAT(message(".xyz", ResultKind::kDense, 1), HasSubstr("known extensions are .npy, .npz"));
}

TEST(FormatRegistry, NamesTheTargetThatAFormatDoesNotHold) {
  VoxelizeRequest request;
  const auto message = [&] {
    return std::string(CheckHolds(".seg.nrrd", ResultKind::kDense, request.targets).message());
  };
  EXPECT_EQ(message(), "");
  request.targets[0].format = VoxelFormat::kF32;
  EXPECT_THAT(message(),
              HasSubstr(".seg.nrrd holds bits, or u8, u16 or u32 of one component; a target of f32 goes into"));
  request.targets[0].format = VoxelFormat::kU16;
  EXPECT_EQ(message(), "");
  request.targets[0].components = 3;
  EXPECT_THAT(message(), HasSubstr("a target of u16x3 goes into"));
  request.targets[0].components = 1;
  request.targets[0].encoding = Encoding::kSnorm;
  EXPECT_THAT(message(), HasSubstr("a target of u16 in snorm goes into"));
  request.targets.resize(2);
  EXPECT_THAT(message(), HasSubstr(".seg.nrrd holds one target; 2 targets go into"));
  EXPECT_TRUE(CheckHolds(".npz", ResultKind::kDense, request.targets).ok());
}

TEST(FormatRegistry, ASegmentationIsOfLabelsUnlessTheRequestSaysOtherwise) {
  VoxelizeRequest request;
  request.fill = Fill::kParity;
  UseDefaultsOf(*FindFormat(".seg.nrrd"), true, true, request);
  EXPECT_EQ(request.targets[0].shader.name, "label");
  EXPECT_EQ(request.targets[0].fill_values, std::vector<double>{1}) << "the whole mesh has the label 1, inside too";
  EXPECT_EQ(request.result, ResultKind::kDense);
  request.parts.scope = PartScope::kNode;
  UseDefaultsOf(*FindFormat(".seg.nrrd"), true, true, request);
  EXPECT_TRUE(request.targets[0].fill_values.empty()) << "that of the owner";
  request.targets[0].shader.name = "mesh_id";
  UseDefaultsOf(*FindFormat(".seg.nrrd"), false, true, request);
  EXPECT_EQ(request.targets[0].shader.name, "mesh_id");
}

// Programs take voxels from -1000 to 999.
TEST(VoxFile, IsCentredAndSaysWhatReachesBeyond) {
  const auto header = [](const std::array<int64_t, 3>& dims) {
    VoxelizeRequest request;
    request.result = ResultKind::kSparse;
    GridSpec grid;
    grid.dims = dims;
    return MakeResultHeader(request, grid, 2, 2, 0);
  };
  const OutputFormat* const vox = FindFormat(".vox");
  ASSERT_NE(vox, nullptr);
  EXPECT_EQ(vox->not_kept(header({2000, 2000, 2000})), "") << "the missing place is known of the format";
  EXPECT_THAT(vox->not_kept(header({5, 5, 2001})), HasSubstr("from -1000 to 999 along each axis"));

  // A voxel at each end of a long grid.
  VoxelizeResult result = AllocateResult(header({2000, 8, 8})).value();
  const std::array<uint64_t, 2> bricks = {0, 249};
  std::memcpy(result.bricks.data(), bricks.data(), sizeof bricks);
  std::memset(result.masks.data(), 0, result.masks.size());
  result.masks.data()[0] = 1;                 // (0, 0, 0)
  result.masks.data()[64] = uint8_t{1} << 7;  // (7, 0, 0) of the last brick
  std::memset(result.targets[0].data(), 0xff, result.targets[0].size());
  const TemporaryDirectory directory;
  ASSERT_TRUE(WriteResult(result, directory / "a.vox").ok());
  const std::vector<uint8_t> file = ReadFile(directory / "a.vox");
  const std::string text(file.begin(), file.end());
  // The centres of models of 256 and 208 voxels.
  EXPECT_THAT(text, HasSubstr("_t" + std::string("\x08\0\0\0", 4) + "-872 0 0"));
  EXPECT_THAT(text, HasSubstr("_t" + std::string("\x07\0\0\0", 4) + "896 0 0"));
}

// Every file of a directory by its name in it; temporary numbers are no part of them.
std::map<std::string, std::vector<uint8_t>> FilesOf(const TemporaryDirectory& directory) {
  std::map<std::string, std::vector<uint8_t>> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(directory.path())) {
    if (entry.is_regular_file()) {
      files[std::filesystem::relative(entry.path(), directory.path()).string()] = ReadFile(entry.path().string());
    }
  }
  return files;
}

// With parts, which every format takes whether it keeps them or not.
VoxelizeResult Sample(Layout layout, const OutputFormat& format) {
  VoxelizeResult result = EmptyResult({9, 5, 19}, layout);
  if (format.keeps == nullptr) {
    AddFloats(result, 3, SampleValue);
  } else {
    AddLabels<uint16_t>(result, [](int64_t i, int64_t j, int64_t k) { return uint32_t(i * j * k % 7); });
  }
  AddHostileParts(result);
  return result;
}

class EachFormat : public ::testing::TestWithParam<std::string> {
 protected:
  const OutputFormat& format() const { return *FindFormat("." + GetParam()); }
};

TEST_P(EachFormat, TakesAResultInPiecesOfAnySize) {
  for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
    const VoxelizeResult result = Sample(layout, format());
    const TemporaryDirectory whole, pieces;
    ASSERT_TRUE(WriteResult(result, whole / ("out." + GetParam())).ok());
    const std::unique_ptr<ResultFile> file = format().open(pieces / ("out." + GetParam()), nullptr);
    ASSERT_TRUE(file->Begin(HeaderOf(result)).ok());
    const std::vector<std::span<const uint8_t>> arrays = ArraysOf(result);
    for (size_t array = 0; array < arrays.size(); ++array) {
      std::span<const uint8_t> left = arrays[array];
      for (size_t size = 1; !left.empty(); size = size % 23 + 1) {
        const std::span<const uint8_t> piece = left.first(std::min(size, left.size()));
        ASSERT_TRUE(file->Write(array, piece).ok());
        left = left.subspan(piece.size());
      }
    }
    EXPECT_FALSE(std::filesystem::exists(pieces / ("out." + GetParam()))) << "before Commit";
    ASSERT_TRUE(file->Commit().ok());
    EXPECT_EQ(FilesOf(whole), FilesOf(pieces));
    EXPECT_FALSE(FilesOf(whole).empty());
  }
}

TEST_P(EachFormat, LeavesNothingOfACancelledOrUnfinishedResult) {
  const TemporaryDirectory directory;
  JobContext job;
  job.Cancel();
  EXPECT_EQ(WriteResult(Sample(Layout::kInterleaved, format()), directory / ("a." + GetParam()), &job).code(),
            absl::StatusCode::kCancelled);
  EXPECT_EQ(directory.FileCount(), 0u);
  {
    const std::unique_ptr<ResultFile> file = format().open(directory / ("a." + GetParam()), nullptr);
    ASSERT_TRUE(file->Begin(HeaderOf(Sample(Layout::kInterleaved, format()))).ok());
    EXPECT_EQ(directory.FileCount(), GetParam() == "raw" ? 2u : 1u) << "under temporary names";
  }
  EXPECT_EQ(directory.FileCount(), 0u);
}

TEST_P(EachFormat, WritesTheKindsThatItHoldsAndRefusesOthers) {
  VoxelizeRequest request;
  request.targets[0].format = VoxelFormat::kU8;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    request.result = kind;
    GridSpec grid;
    grid.dims = {3, 4, 5};
    VoxelizeResult result = AllocateResult(MakeResultHeader(request, grid, 1, 2, 2)).value();
    for (const auto array : MutableArraysOf(result)) std::memset(array.data(), 0, array.size());
    if (kind == ResultKind::kSparse) result.masks.data()[8] = 5;  // (0, 0, 1) and (2, 0, 1)
    if (kind == ResultKind::kBuckets) {
      const std::array<uint64_t, 2> voxels = {7, 20};
      const std::array<uint64_t, 3> offsets = {0, 1, 2};
      std::memcpy(result.voxels.data(), voxels.data(), sizeof voxels);
      std::memcpy(result.offsets.data(), offsets.data(), sizeof offsets);
    }
    const TemporaryDirectory directory;
    const absl::Status status = WriteResult(result, directory / ("a." + GetParam()));
    EXPECT_EQ(status.ok(), format().Holds(kind)) << status;
    EXPECT_EQ(directory.FileCount() > 0, format().Holds(kind));
  }
}

std::vector<std::string> FormatsWithWriters() {
  std::vector<std::string> names;
  for (const OutputFormat& format : OutputFormats()) {
    if (!format.picture()) names.emplace_back(format.name);
  }
  return names;
}

INSTANTIATE_TEST_SUITE_P(Formats, EachFormat, ::testing::ValuesIn(FormatsWithWriters()),
                         [](const ::testing::TestParamInfo<std::string>& tested) {
                           std::string name = tested.param;
                           std::erase(name, '.');
                           return name;
                         });

}  // namespace
}  // namespace voxelpipe
