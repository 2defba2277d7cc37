// The table of parts in files that have room for it: .raw.json, .zarr and .vti.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <future>
#include <numeric>

#include "absl/strings/str_split.h"
#include "base/text.h"
#include "encode/encode.h"
#include "encode/read/stored_result.h"
#include "encode/result_file.h"
#include "support/json/json.h"
#include "unit/encode/file_readers.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using namespace testing;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr size_t kMaxPartCount = 65'535;

VoxelizeResult Labelled() {
  VoxelizeResult result = EmptyResult({4, 5, 6});
  AddLabels<uint8_t>(result, [](int64_t i, int64_t j, int64_t) { return uint32_t((i + j) % 3); });
  return result;
}

VoxelizeResult WithMostParts() {
  VoxelizeResult result = Labelled();
  std::vector<SamplePart> parts;
  for (uint32_t n = 1; n <= kMaxPartCount; ++n) parts.emplace_back(n, absl::StrCat("part ", n));
  AddParts(result, parts);
  return result;
}

// The name in JSON: invalid bytes as the character for them, all else as it was.
std::string JsonName(const std::string& name) {
  return json::parse(json(name).dump(-1, ' ', false, json::error_handler_t::replace)).get<std::string>();
}

void ExpectTable(const json& parts, const PartTable& table) {
  EXPECT_EQ(parts.at("label").get<std::vector<uint32_t>>(), table.label);
  EXPECT_EQ(parts.at("priority").get<std::vector<int32_t>>(), table.priority);
  EXPECT_EQ(parts.at("triangles").get<std::vector<uint64_t>>(), table.triangles);
  ASSERT_EQ(parts.contains("voxels"), !table.voxels.empty());
  if (!table.voxels.empty()) {
    EXPECT_EQ(parts.at("open_edges").get<std::vector<uint64_t>>(), table.open_edges);
    EXPECT_EQ(parts.at("odd_columns").get<std::vector<uint64_t>>(), table.odd_columns);
    EXPECT_EQ(parts.at("voxels").get<std::vector<uint64_t>>(), table.voxels);
  }
  ASSERT_EQ(parts.at("name").size(), table.size());
  for (size_t i = 0; i < table.size(); ++i) {
    EXPECT_EQ(parts["name"][i].get<std::string>(), JsonName(std::string(table.Name(i)))) << i;
  }
}

TEST(PartsInFiles, RawDescribesThem) {
  const TemporaryDirectory directory;
  VoxelizeResult result = Labelled();
  ASSERT_TRUE(WriteResult(result, directory / "none.raw").ok());
  EXPECT_FALSE(ParseJson(ReadFile(directory / "none.raw.json")).contains("parts"));
  for (const bool filled : {false, true}) {
    AddParts(result, {{2, "a"}, {1, "b"}}, filled);
    ASSERT_TRUE(WriteResult(result, directory / "a.raw").ok());
    ExpectTable(ParseJson(ReadFile(directory / "a.raw.json")).at("parts"), result.parts);
  }
  AddHostileParts(result);
  ASSERT_TRUE(WriteResult(result, directory / "b.raw").ok());
  ExpectTable(ParseJson(ReadFile(directory / "b.raw.json")).at("parts"), result.parts);
  for (const uint8_t byte : ReadFile(directory / "b.raw.json")) {
    EXPECT_TRUE(byte == '\n' || (byte >= 0x20 && byte != 0x7f)) << "a control character as it is";
  }
}

TEST(PartsInFiles, ARawOfTheMostPartsIsReadAgain) {
  const TemporaryDirectory directory;
  const VoxelizeResult result = WithMostParts();
  ASSERT_TRUE(WriteResult(result, directory / "a.raw").ok());
  ExpectTable(ParseJson(ReadFile(directory / "a.raw.json")).at("parts"), result.parts);
  const absl::StatusOr<StoredResult> read = OpenResult(directory / "a.raw");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->dims, result.grid.dims);
}

TEST(PartsInFiles, ZarrHasThemInTheAttributesOfItsRoot) {
  const TemporaryDirectory directory;
  VoxelizeResult result = Labelled();
  ASSERT_TRUE(WriteResult(result, directory / "none.zarr").ok());
  const json without = ParseJson(ReadFile(directory / "none.zarr/.zattrs"));
  EXPECT_FALSE(without["voxelpipe"].contains("parts"));
  EXPECT_FALSE(without.contains("image-label"));

  AddHostileParts(result);
  ASSERT_TRUE(WriteResult(result, directory / "one.zarr").ok());
  const json one = ParseJson(ReadFile(directory / "one.zarr/.zattrs"));
  EXPECT_EQ(one["voxelpipe"]["dims"], json({4, 5, 6}));
  for (const uint8_t byte : ReadFile(directory / "one.zarr/.zattrs")) EXPECT_LT(byte, 0x7f) << "zarr 2 reads ASCII";
  ExpectTable(one["voxelpipe"]["parts"], result.parts);
  const json& label = one["image-label"];
  EXPECT_EQ(label["version"], "0.4");
  ASSERT_EQ(label["colors"].size(), HostileNames().size());
  EXPECT_EQ(label["colors"][0], ParseJson(R"({"label-value": 1, "rgba": [230, 159, 0, 255]})"));
  EXPECT_EQ(label["properties"][2]["label-value"], 3);
  EXPECT_EQ(label["properties"][2]["name"], HostileNames()[2].second);

  AddFloats(result, 1, SampleValue);
  ASSERT_TRUE(WriteResult(result, directory / "two.zarr").ok());
  ExpectTable(ParseJson(ReadFile(directory / "two.zarr/.zattrs"))["voxelpipe"]["parts"], result.parts);
  EXPECT_TRUE(ParseJson(ReadFile(directory / "two.zarr/target0/.zattrs")).contains("image-label"));
  const json values = ParseJson(ReadFile(directory / "two.zarr/target1/.zattrs"));
  EXPECT_FALSE(values.contains("image-label"));
  EXPECT_FALSE(values["voxelpipe"].contains("parts"));

  const VoxelizeResult most = WithMostParts();
  ASSERT_TRUE(WriteResult(most, directory / "most.zarr").ok());
  ExpectTable(ParseJson(ReadFile(directory / "most.zarr/.zattrs"))["voxelpipe"]["parts"], most.parts);
}

template <typename T>
std::vector<T> VtiNumbers(const std::string& file, const std::string& name) {
  const std::string bytes = VtiArray(file, name);
  std::vector<T> numbers(bytes.size() / sizeof(T));
  std::memcpy(numbers.data(), bytes.data(), bytes.size());
  return numbers;
}

void ExpectFields(const std::string& file, const PartTable& table) {
  const std::string count = absl::StrCat("NumberOfTuples=\"", table.size(), "\"");
  EXPECT_THAT(file, HasSubstr(absl::StrCat("<DataArray type=\"UInt32\" Name=\"part_label\" ", count)));
  EXPECT_THAT(file, HasSubstr(absl::StrCat("<DataArray type=\"Int32\" Name=\"part_priority\" ", count)));
  EXPECT_THAT(file, HasSubstr(absl::StrCat("<Array type=\"String\" Name=\"part_name\" ", count)));
  EXPECT_EQ(VtiNumbers<uint32_t>(file, "part_label"), table.label);
  EXPECT_EQ(VtiNumbers<int32_t>(file, "part_priority"), table.priority);
  EXPECT_EQ(VtiNumbers<uint64_t>(file, "part_triangles"), table.triangles);
  if (!table.voxels.empty()) {
    EXPECT_THAT(file, HasSubstr(absl::StrCat("<DataArray type=\"Int64\" Name=\"part_voxels\" ", count)));
    EXPECT_EQ(VtiNumbers<uint64_t>(file, "part_open_edges"), table.open_edges);
    EXPECT_EQ(VtiNumbers<uint64_t>(file, "part_odd_columns"), table.odd_columns);
    EXPECT_EQ(VtiNumbers<uint64_t>(file, "part_voxels"), table.voxels);
  }
  const std::string names = VtiArray(file, "part_name");
  ASSERT_TRUE(names.ends_with('\0'));
  const std::vector<std::string> read = absl::StrSplit(names.substr(0, names.size() - 1), '\0');
  ASSERT_EQ(read.size(), table.size());
  for (size_t i = 0; i < table.size(); ++i) EXPECT_EQ(read[i], CleanText(table.Name(i))) << i;
}

TEST(PartsInFiles, VtiHasFieldDataInFilesAndStreams) {
  const TemporaryDirectory directory;
  VoxelizeResult result = Labelled();
  AddFloats(result, 2, SampleValue);
  ASSERT_TRUE(WriteResult(result, directory / "none.vti").ok());
  EXPECT_THAT(WrittenText(directory / "none.vti"), Not(HasSubstr("FieldData")));
  const std::string fifo = directory / "fifo.vti";
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);
  const auto check = [&] {
    ASSERT_TRUE(WriteResult(result, directory / "a.vti").ok());
    std::future<std::string> stream = std::async(std::launch::async, [&] { return WrittenText(fifo); });
    ASSERT_TRUE(WriteResult(result, fifo).ok());
    for (const std::string& file : {WrittenText(directory / "a.vti"), stream.get()}) {
      ExpectFields(file, result.parts);
      const auto labels = result.targets[0].bytes(), floats = result.targets[1].bytes();
      EXPECT_EQ(VtiArray(file, "target0"), std::string(labels.begin(), labels.end()));
      EXPECT_EQ(VtiArray(file, "target1"), std::string(floats.begin(), floats.end()));
      EXPECT_TRUE(file.ends_with("\n  </AppendedData>\n</VTKFile>\n"));
    }
  };
  AddParts(result, {{2, ""}, {1, ""}}, false);
  check();
  AddHostileParts(result);
  check();
  std::vector<SamplePart> parts;
  for (uint32_t n = 1; n <= kMaxPartCount; ++n) parts.emplace_back(n, absl::StrCat("part ", n));
  AddParts(result, parts);
  check();
}

}  // namespace
}  // namespace voxelpipe
