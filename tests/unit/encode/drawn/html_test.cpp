#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include "absl/strings/escaping.h"
#include "encode/encode.h"
#include "support/json/json.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using testing::AddBits;
using testing::BitFormula;
using testing::EmptyResult;
using testing::ParseJson;
using testing::ReadFile;
using testing::TemporaryDirectory;

// The data of a page, as drawn/html.cpp describes it.
struct PageData {
  nlohmann::json description;
  std::vector<std::array<uint16_t, 4>> cells;
};

PageData ReadPage(const std::string& path) {
  const std::vector<uint8_t> file = ReadFile(path);
  const std::string page(file.begin(), file.end());
  const std::string opening = "id=\"voxels\">";
  const size_t begin = page.find(opening) + opening.size();
  std::string packed;
  EXPECT_TRUE(absl::Base64Unescape(page.substr(begin, page.find('<', begin) - begin), &packed));
  std::string bytes(size_t{64} << 20, '\0');
  uLongf size = bytes.size();
  EXPECT_EQ(uncompress(reinterpret_cast<Bytef*>(bytes.data()), &size, reinterpret_cast<const Bytef*>(packed.data()),
                       packed.size()),
            Z_OK);
  bytes.resize(size);
  EXPECT_EQ(bytes.substr(0, 4), "VXV1");
  uint32_t text_bytes = 0;
  std::memcpy(&text_bytes, &bytes.at(4), sizeof text_bytes);
  PageData data{ParseJson(bytes.substr(8, text_bytes)), {}};
  data.cells.resize(data.description.at("voxels").get<size_t>());
  EXPECT_GE(bytes.size(), 8 + text_bytes + 8 * data.cells.size());
  if (!data.cells.empty()) std::memcpy(data.cells.data(), &bytes.at(8 + text_bytes), 8 * data.cells.size());
  return data;
}

// The solid voxels in linear order, by the rule that viewers use: rows are solid from a listed voxel whose +x side is
// covered to the next one.
std::vector<bool> SolidOf(const PageData& data) {
  const auto dims = data.description.at("dims").get<std::array<size_t, 3>>();
  std::vector<bool> solid(dims[0] * dims[1] * dims[2]);
  for (size_t n = 0; n < data.cells.size(); ++n) {
    const auto [x, y, z, sides] = data.cells[n];
    const size_t end = (sides & 2) != 0 ? x + size_t{1} : data.cells.at(n + 1)[0];
    for (size_t i = x; i < end; ++i) solid.at(i + dims[0] * (y + dims[1] * z)) = true;
  }
  return solid;
}

class HtmlPage : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!IsKnownExtension(".html")) GTEST_SKIP() << "this build has no viewer";
  }
  PageData Write(std::array<int64_t, 3> dims, const BitFormula& formula) {
    VoxelizeResult result = EmptyResult(dims);
    AddBits(result, formula);
    const absl::Status status = WriteResult(result, directory_ / "page.html");
    EXPECT_TRUE(status.ok()) << status;
    return ReadPage(directory_ / "page.html");
  }

  TemporaryDirectory directory_;
};

TEST_F(HtmlPage, ExposedVoxelsTellWhereTheInsideIs) {
  const std::array<int64_t, 3> dims = {70, 40, 33};
  // A ball that the grid cuts, with a hollow and single holes.
  const BitFormula formula = [](int64_t i, int64_t j, int64_t k) {
    const int64_t d = (i - 50) * (i - 50) + (j - 20) * (j - 20) + (k - 16) * (k - 16);
    return d < 900 && d > 25 && (i % 7 != 3 || j % 5 != 1 || k % 6 != 2);
  };
  const PageData data = Write(dims, formula);
  std::vector<bool> expected;
  for (int64_t k = 0; k < dims[2]; ++k) {
    for (int64_t j = 0; j < dims[1]; ++j) {
      for (int64_t i = 0; i < dims[0]; ++i) expected.push_back(formula(i, j, k));
    }
  }
  EXPECT_EQ(SolidOf(data), expected);
  EXPECT_LT(data.cells.size(), size_t(std::count(expected.begin(), expected.end(), true)));
}

TEST_F(HtmlPage, JoinedVoxelsTellItToo) {
  // 128^3 / 2 voxels of six faces each: more than a page draws.
  const PageData data = Write({128, 128, 128}, [](int64_t i, int64_t j, int64_t k) { return (i + j + k) % 2 == 0; });
  EXPECT_EQ(data.description.at("step"), 2);
  EXPECT_EQ(SolidOf(data), std::vector<bool>(64 * 64 * 64, true));
  EXPECT_EQ(data.cells.size(), 64u * 64 * 64 - 62 * 62 * 62);
}

TEST_F(HtmlPage, EmptyGridHasNoVoxels) {
  EXPECT_TRUE(Write({5, 4, 3}, [](int64_t, int64_t, int64_t) { return false; }).cells.empty());
}

TEST_F(HtmlPage, ListsThePartsByLabel) {
  const TemporaryDirectory directory;
  VoxelizeResult result = EmptyResult({8, 8, 8});
  testing::AddLabels<uint16_t>(result, [](int64_t i, int64_t, int64_t) { return uint32_t(1 + i % 4); });
  ASSERT_TRUE(WriteResult(result, directory / "without.html").ok());
  const nlohmann::json without = ReadPage(directory / "without.html").description;
  EXPECT_FALSE(without.contains("labels"));
  EXPECT_EQ(without["targets"][0]["shows"], "number");

  testing::AddHostileParts(result);
  result.parts.label[9] = 1;  // that of the first, too
  ASSERT_TRUE(WriteResult(result, directory / "a.html").ok());
  const nlohmann::json description = ReadPage(directory / "a.html").description;
  EXPECT_EQ(description["targets"][0]["shows"], "label");
  const nlohmann::json& labels = description["labels"];
  ASSERT_EQ(labels.size(), testing::HostileNames().size() - 1);
  for (size_t i = 0; i < labels.size(); ++i) EXPECT_EQ(labels[i]["name"], testing::HostileNames()[i].second);
  EXPECT_EQ(labels[0], ParseJson(R"({"label": 1, "name": "plain", "colour": 15113984, "parts": 2, "triangles": 29,
                                     "voxels": 209})"));
  const std::vector<uint8_t> file = ReadFile(directory / "a.html");
  const std::string page(file.begin(), file.end());
  EXPECT_EQ(page.find("&amp;]]>"), std::string::npos) << "names are in the packed data alone";
}

}  // namespace
}  // namespace voxelpipe
