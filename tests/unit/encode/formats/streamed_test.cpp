// .vti, .nrrd and .nii.gz.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <future>
#include <numeric>

#include "encode/encode.h"
#include "encode/formats/deflate.h"
#include "encode/formats/nifti_header.h"
#include "encode/formats/plain_elements.h"
#include "encode/result_file.h"
#include "unit/encode/file_readers.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using testing::AddBits;
using testing::AddFloats;
using testing::EmptyResult;
using ::testing::HasSubstr;
using testing::Inflated;
using testing::NumberAt;
using testing::ReadFile;
using testing::SampleBit;
using testing::SampleValue;
using testing::TemporaryDirectory;
using testing::VtiArray;
using testing::WrittenText;

VoxelizeResult Placed(std::array<int64_t, 3> dims, Layout layout = Layout::kInterleaved) {
  VoxelizeResult result = EmptyResult(dims, layout);
  result.grid.origin = {10, 20, 30};
  result.grid.voxel_size = {0.1, 0.2, 0.4};
  return result;
}

TEST(VtiFile, HasTheGridAndAnArrayATarget) {
  const TemporaryDirectory directory;
  VoxelizeResult result = Placed({5, 7, 3});
  AddBits(result, SampleBit);
  AddFloats(result, 2, SampleValue);
  ASSERT_TRUE(WriteResult(result, directory / "a.vti").ok());
  const std::string file = WrittenText(directory / "a.vti");
  EXPECT_THAT(file, HasSubstr("version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\""));
  EXPECT_THAT(file, HasSubstr("WholeExtent=\"0 5 0 7 0 3\" Origin=\"10 20 30\" Spacing=\"0.1 0.2 0.4\""));
  EXPECT_THAT(file, HasSubstr("type=\"UInt8\" Name=\"target0\" NumberOfComponents=\"1\""));
  EXPECT_THAT(file, HasSubstr("type=\"Float32\" Name=\"target1\" NumberOfComponents=\"2\""));
  const std::string bits = VtiArray(file, "target0"), floats = VtiArray(file, "target1");
  ASSERT_EQ(bits.size(), 105u);
  for (int64_t n = 0; n < 105; ++n) EXPECT_EQ(bits[size_t(n)] != 0, SampleBit(n % 5, n / 5 % 7, n / 35)) << n;
  const auto stored = result.targets[1].bytes();
  EXPECT_EQ(floats, std::string(stored.begin(), stored.end()));
}

TEST(VtiFile, PlanesAreArraysOfTheirOwnAndBlocksMayBeWhole) {
  const TemporaryDirectory directory;
  VoxelizeResult result = Placed({64, 64, 64}, Layout::kPlanar);  // 1 MiB a plane of floats: one whole block
  AddFloats(result, 2, SampleValue);
  ASSERT_TRUE(WriteResult(result, directory / "a.vti").ok());
  const std::string file = WrittenText(directory / "a.vti");
  const auto stored = result.targets[0].bytes();
  EXPECT_EQ(VtiArray(file, "target0_0") + VtiArray(file, "target0_1"), std::string(stored.begin(), stored.end()));
}

TEST(VtiFile, OffsetsBeyond4GiBHave64Bits) {
  const TemporaryDirectory directory;
  const std::string path = directory / "a.vti";
  ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
  // The document alone: a stream has the offsets at its beginning.
  std::future<std::string> head = std::async(std::launch::async, [&] { return WrittenText(path); });
  VoxelizeRequest request;
  request.targets[0].format = VoxelFormat::kU8;
  request.targets.push_back(request.targets[0]);
  GridSpec grid;
  grid.dims = {2048, 2048, 1025};
  {
    const std::unique_ptr<ResultFile> file = OpenResultFile(path, nullptr).value();
    ASSERT_TRUE(file->Begin(DenseHeader(request, grid)).ok());
  }
  const std::string text = head.get();
  EXPECT_THAT(text, HasSubstr("Name=\"target1\" NumberOfComponents=\"1\" format=\"appended\" offset=\"" +
                              std::string("00000000004299161608\"")));
  EXPECT_EQ(NumberAt<uint64_t>(text, text.find('_', text.find("<AppendedData")) + 1), 4299161600u);
}

TEST(NrrdFile, HasComponentsFirstOrLast) {
  const TemporaryDirectory directory;
  for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
    VoxelizeResult result = Placed({4, 5, 6}, layout);
    AddFloats(result, 3, SampleValue);
    ASSERT_TRUE(WriteResult(result, directory / "a.nrrd").ok());
    const std::string file = WrittenText(directory / "a.nrrd");
    const size_t end = file.find("\n\n") + 2;
    const std::string head = file.substr(0, end);
    const bool planar = layout == Layout::kPlanar;
    EXPECT_THAT(head, HasSubstr("NRRD0004\n"));
    EXPECT_THAT(head, HasSubstr(planar ? "\nsizes: 4 5 6 3\n" : "\nsizes: 3 4 5 6\n"));
    EXPECT_THAT(head,
                HasSubstr(planar ? "(0,0,0.4) none\n" : "\nspace directions: none (0.1,0,0) (0,0.2,0) (0,0,0.4)\n"));
    EXPECT_THAT(head, HasSubstr("\nspace: right-anterior-superior\n")) << "as in .nii.gz";
    EXPECT_THAT(head, HasSubstr("\nspace origin: (10.05,20.1,30.2)\n"));
    const auto stored = result.targets[0].bytes();
    EXPECT_EQ(Inflated({reinterpret_cast<const uint8_t*>(&file[end]), file.size() - end}),
              std::string(stored.begin(), stored.end()));
  }
}

TEST(NiftiFile, ComponentsAreTheSlowestAxis) {
  const TemporaryDirectory directory;
  std::array<std::string, 2> files;
  for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
    VoxelizeResult result = Placed({4, 5, 6}, layout);
    AddFloats(result, 3, SampleValue);
    ASSERT_TRUE(WriteResult(result, directory / "a.nii.gz").ok());
    files[size_t(layout)] = Inflated(ReadFile(directory / "a.nii.gz"));
    if (layout == Layout::kInterleaved) continue;
    const auto stored = result.targets[0].bytes();
    EXPECT_EQ(files[1].substr(352), std::string(stored.begin(), stored.end()));
  }
  EXPECT_EQ(files[0], files[1]);
  EXPECT_EQ(NumberAt<int32_t>(files[0], 0), 348);
  EXPECT_EQ(files[0].substr(344, 4), std::string("n+1\0", 4));
  for (const auto& [at, dim] : {std::pair{40, 5}, {42, 4}, {44, 5}, {46, 6}, {48, 1}, {50, 3}}) {
    EXPECT_EQ(NumberAt<int16_t>(files[0], size_t(at)), dim) << at;
  }
  EXPECT_EQ(NumberAt<int16_t>(files[0], 70), 16);          // float32
  EXPECT_EQ(NumberAt<float>(files[0], 108), 352.0f);       // vox_offset
  EXPECT_EQ(NumberAt<float>(files[0], 280 + 12), 10.05f);  // srow_x[3]: a centre
}

TEST(NiftiHeader, LongAxesTakeTheSecondVersion) {
  VoxelizeRequest request;
  GridSpec grid;
  grid.dims = {32767, 1, 1};
  EXPECT_EQ(NiftiHeader(DenseHeader(request, grid)).size(), 352u);
  EXPECT_EQ(NiftiHeader(DenseHeader(request, grid))[123], 0) << "no unit";
  grid.dims = {2, 300000, 70000};  // 4.2e10 voxels
  grid.origin = {0, 0.1, 0};
  const std::string header = NiftiHeader(DenseHeader(request, grid));
  ASSERT_EQ(header.size(), 544u);
  EXPECT_EQ(NumberAt<int32_t>(header, 0), 540);
  EXPECT_EQ(header.substr(4, 8), std::string("n+2\0\r\n\x1a\n", 8));
  EXPECT_EQ(NumberAt<int64_t>(header, 16 + 16), 300000);
  EXPECT_EQ(NumberAt<int64_t>(header, 16 + 24), 70000);
  EXPECT_EQ(NumberAt<int64_t>(header, 168), 544);      // vox_offset
  EXPECT_EQ(NumberAt<double>(header, 432 + 24), 0.6);  // srow_y[3]
  EXPECT_EQ(NumberAt<int32_t>(header, 500), 0);        // no unit: that of the mesh is not known
}

TEST(NiftiHeader, PlacesThatFloatsDoNotHoldTakeTheSecondVersion) {
  VoxelizeRequest request;
  GridSpec grid;
  grid.dims = {34, 34, 18};
  grid.voxel_size = {0.1, 0.1, 0.1};
  grid.origin = {7, 45, 8};
  EXPECT_EQ(NiftiHeader(DenseHeader(request, grid)).size(), 352u);
  grid.origin = {701362.5, 4485513, 812};  // floats there are half a metre apart
  const std::string header = NiftiHeader(DenseHeader(request, grid));
  ASSERT_EQ(header.size(), 544u);
  EXPECT_EQ(NumberAt<double>(header, 432 + 24), 4485513 + 0.5 * 0.1);  // srow_y[3]
  grid.voxel_size = {1000, 1000, 1000};
  EXPECT_EQ(NiftiHeader(DenseHeader(request, grid)).size(), 352u) << "to a thousandth of a voxel";
}

TEST(Gzip, PartsMakeOneStream) {
  std::string file = GzipHeader(), whole;
  const auto append = [&](std::span<const uint8_t> bytes) {
    file.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    return absl::OkStatus();
  };
  std::vector<DeflatePart> parts(3);
  for (size_t i = 0; i < parts.size(); ++i) {
    if (i == 1) {  // empty
      ASSERT_TRUE(parts[i].Finish(append).ok());
      continue;
    }
    std::vector<uint8_t> bytes(100000 + i);
    std::iota(bytes.begin(), bytes.end(), uint8_t(i));
    whole.append(bytes.begin(), bytes.end());
    ASSERT_TRUE(parts[i].Write(bytes, append).ok());
    ASSERT_TRUE(parts[i].Finish(append).ok());
  }
  file += GzipEnd(parts);
  EXPECT_EQ(Inflated({reinterpret_cast<const uint8_t*>(file.data()), file.size()}), whole);
}

TEST(PlainElements, WidensHalvesThatPiecesSplit) {
  const std::vector<uint8_t> halves = {0x00, 0x3c, 0x00, 0xc0, 0x01, 0x00};  // 1, -2, the smallest
  std::string bytes;
  PlainElements elements(ElementType::kF16, 3);
  for (const uint8_t byte : halves) {
    ASSERT_TRUE(elements
                    .Write({&byte, 1},
                           [&](std::span<const uint8_t> plain) {
                             bytes.append(plain.begin(), plain.end());
                             return absl::OkStatus();
                           })
                    .ok());
  }
  ASSERT_EQ(bytes.size(), 12u);
  EXPECT_EQ(NumberAt<float>(bytes, 0), 1.0f);
  EXPECT_EQ(NumberAt<float>(bytes, 4), -2.0f);
  EXPECT_EQ(NumberAt<float>(bytes, 8), 0x1p-24f);
}

}  // namespace
}  // namespace voxelpipe
