// The list of a batch: what it may hold, and what is said of what it may not.
#include "batch/manifest.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "unit/encode/sample_results.h"

namespace voxelpipe::cli {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;
using testing::TemporaryDirectory;

class ManifestTest : public ::testing::Test {
 protected:
  void Write(const std::string& text) { std::ofstream(path_, std::ios::binary) << text; }
  absl::StatusOr<std::vector<BatchItem>> Read(const Shard& shard = {}) {
    absl::StatusOr<ManifestReader> manifest = ManifestReader::Open(path_, defaults_, shard);
    if (!manifest.ok()) return manifest.status();
    std::vector<BatchItem> items;
    for (;;) {
      absl::StatusOr<std::optional<BatchItem>> item = manifest->Next();
      if (!item.ok()) return item.status();
      if (!*item) return items;
      items.push_back(**std::move(item));
    }
  }
  std::vector<BatchItem> Items(const std::string& text, const Shard& shard = {}) {
    Write(text);
    absl::StatusOr<std::vector<BatchItem>> items = Read(shard);
    EXPECT_TRUE(items.ok()) << items.status();
    return items.ok() ? *std::move(items) : std::vector<BatchItem>(1);
  }
  // What is said after the file's name.
  std::string Error(const std::string& text) {
    Write(text);
    const absl::Status status = ManifestReader::Open(path_, defaults_).status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << text << status;
    const std::string message(status.message());
    EXPECT_THAT(message, StartsWith(path_ + ":"));
    return message.substr(std::min(message.size(), path_.size() + 1));
  }

  TemporaryDirectory directory_;
  std::string path_ = directory_ / "list.jsonl";
  ManifestDefaults defaults_;
};

TEST_F(ManifestTest, AnInputAloneIsEnough) {
  const std::vector<BatchItem> items = Items("{\"input\": \"/m/a.glb\"}\n\n  \n{\"input\": \"/m/b.drc\"}");
  ASSERT_EQ(items.size(), 2u);
  EXPECT_EQ(items[0].line, 1u);
  EXPECT_EQ(items[0].id, "a");
  EXPECT_EQ(items[0].input, "/m/a.glb");
  EXPECT_EQ(items[0].output, "a.npy");
  EXPECT_EQ(items[0].preview, "");
  EXPECT_EQ(items[0].request->request.grid.resolution, 128);
  EXPECT_EQ(items[1].line, 4u);
  EXPECT_EQ(items[1].output, "b.npy");
  EXPECT_EQ(items[0].request, items[1].request);  // kept once
}

TEST_F(ManifestTest, AnItemsViewReplacesTheDefaultOfPictures) {
  defaults_.view = "top";
  const std::vector<BatchItem> items = Items(
      "{\"input\":\"a\",\"preview\":\"a.png\",\"view\":\"front\"}\n{\"input\":\"b\",\"output\":\"b.png\"}\n"
      "{\"input\":\"c\"}");
  ASSERT_EQ(items.size(), 3u);
  EXPECT_EQ(items[0].view, (PreviewView{0, 0}));
  EXPECT_EQ(items[1].view, (PreviewView{0, 90}));
  EXPECT_EQ(items[2].view, PreviewView());  // without a picture
}

TEST_F(ManifestTest, TakesEveryOptionByItsName) {
  const BatchItem item = Items(
      R"({"input":"a.glb","id":7,"voxel-size":[0.5,0.25,1],"dims":"4,5,6","origin":[-1,0,2.5],"padding":2,)"
      R"("coverage":"thin","fill":"flood","target":["u8:max","f32x3:replace:shader=normal"],"layout":"planar",)"
      R"("result":"sparse","backend":"cpu","simd":"scalar","threads":3,"vertex_shader":"identity","preview":"p/7.png"})")
      [0];
  EXPECT_EQ(item.id, "7");
  EXPECT_EQ(item.output, "7.npz");  // a list does not fit into .npy
  EXPECT_EQ(item.preview, "p/7.png");
  const VoxelizeRequest& request = item.request->request;
  EXPECT_EQ(*request.grid.voxel_size, (Vec3d{0.5, 0.25, 1}));
  EXPECT_EQ(*request.grid.dims, (std::array<int64_t, 3>{4, 5, 6}));
  EXPECT_EQ(*request.grid.origin, (Vec3d{-1, 0, 2.5}));
  EXPECT_EQ(request.grid.padding, 2);
  EXPECT_EQ(request.coverage, Coverage::kThin);
  EXPECT_EQ(request.fill, Fill::kFlood);
  ASSERT_EQ(request.targets.size(), 2u);
  EXPECT_EQ(request.targets[1].shader.name, "normal");
  EXPECT_EQ(request.layout, Layout::kPlanar);
  EXPECT_EQ(request.result, ResultKind::kSparse);
  EXPECT_EQ(request.backend, BackendChoice::kCpu);
  EXPECT_EQ(request.simd, SimdChoice::kScalar);
  EXPECT_EQ(request.threads, 3);
}

TEST_F(ManifestTest, AnItemsWayToAGridReplacesTheDefaultOne) {
  defaults_.request.resolution = 64;
  defaults_.request.fit = "cube";
  EXPECT_EQ(*Items(R"({"input":"a","voxel_size":0.1})")[0].request->request.grid.voxel_size, (Vec3d{0.1, 0.1, 0.1}));
  EXPECT_EQ(Items(R"({"input":"a","resolution":9})")[0].request->request.grid.fit, GridFit::kCube);
  defaults_.request = RequestOptions();
  defaults_.request.voxel_size = "0.5";
  EXPECT_EQ(Items(R"({"input":"a","resolution":9})")[0].request->request.grid.resolution, 9);
  EXPECT_EQ(Items(R"({"input":"a"})")[0].request->request.grid.voxel_size->x, 0.5);
}

TEST_F(ManifestTest, NamesOutputsByIdStemAndFormat) {
  defaults_.format = "raw";
  const auto output = [&](const std::string& keys) { return Items("{\"input\":\"d/m.x.glb\"" + keys + "}")[0].output; };
  EXPECT_EQ(output(""), "m.x.raw");
  EXPECT_EQ(output(R"(,"id":"s/b.1")"), "s/b.1.raw");
  EXPECT_EQ(output(R"(,"name":"n","format":"npz")"), "n.npz");
  EXPECT_EQ(output(R"(,"output":"./q//r.PNG")"), "q/r.PNG");
  EXPECT_EQ(output(R"(,"output":"q/r")"), "q/r.raw");
  EXPECT_EQ(output(R"(,"id":"a","output":"r.npy","format":"npy")"), "r.npy");
}

TEST_F(ManifestTest, LooksForInputsBesideTheManifestFirst) {
  std::ofstream(directory_ / "here.glb") << "x";
  EXPECT_EQ(Items(R"({"input":"here.glb"})")[0].input, directory_ / "here.glb");
  EXPECT_EQ(Items(R"({"input":"nowhere.glb"})")[0].input, directory_ / "nowhere.glb");
  EXPECT_EQ(Items(R"({"input":"/abs.glb"})")[0].input, "/abs.glb");
}

TEST_F(ManifestTest, ErrorsNameTheLine) {
  EXPECT_THAT(Error("{\"input\":\"a\"}\n\n{\"input\":"), StartsWith("3: no JSON"));
  EXPECT_THAT(Error("[1]"), StartsWith("1: a JSON object"));
  EXPECT_THAT(Error("{}"), HasSubstr("'input' is missing"));
  EXPECT_THAT(Error(R"({"input":5})"), HasSubstr("'input': a text"));
  EXPECT_THAT(Error(R"({"input":""})"), HasSubstr("must not be empty"));
  EXPECT_THAT(Error(R"({"input":"a","fil":"parity"})"), HasSubstr("unknown key 'fil'"));
  EXPECT_THAT(Error(R"({"input":"a","target":"bit","targets":["u8"]})"), HasSubstr("'target' is given twice"));
  EXPECT_THAT(Error(R"({"input":"a","voxel-size":1,"voxel_size":2})"), HasSubstr("'voxel_size' is given twice"));
  EXPECT_THAT(Error(R"({"input":"a","fill":"maybe"})"), HasSubstr("1: fill: unknown choice"));
  EXPECT_THAT(Error(R"({"input":"a","resolution":1.5})"), HasSubstr("whole number"));
  EXPECT_THAT(Error(R"({"input":"a","resolution":0})"), HasSubstr("1: resolution: at least"));
  EXPECT_THAT(Error(R"({"input":"a","threads":-1})"), HasSubstr("out of range"));
  EXPECT_THAT(Error(R"({"input":"a","padding":99999999999999999999})"), HasSubstr("'padding'"));
  EXPECT_THAT(Error(R"({"input":"a","dims":["x"]})"), HasSubstr("list of numbers"));
  EXPECT_THAT(Error(R"({"input":"a","target":[]})"), HasSubstr("'target'"));
  EXPECT_THAT(Error(R"({"input":"a","id":"x","name":"y"})"), HasSubstr("the same"));
  EXPECT_THAT(Error("{\"input\":\"" + std::string(2 << 20, 'a') + "\"}"), HasSubstr("longer than"));
}

TEST_F(ManifestTest, OutputsThatCannotBeAreErrors) {
  EXPECT_THAT(Error(R"({"input":"a","output":"x.xyz"})"), HasSubstr("no known format"));
  EXPECT_THAT(Error(R"({"input":"a","output":"x.npy","result":"buckets"})"), HasSubstr(".npz"));
  EXPECT_THAT(Error(R"({"input":"a","format":"npy","result":"sparse"})"), HasSubstr(".npz"));
  EXPECT_THAT(Error(R"({"input":"a","output":"x.npy","format":"raw"})"), HasSubstr("differ"));
  EXPECT_THAT(Error(R"({"input":"a","preview":"x.npy"})"), HasSubstr(".png"));
  EXPECT_THAT(Error(R"({"input":"a","preview":"x.png","view":"sideways"})"), HasSubstr("'view': 'sideways'"));
  EXPECT_THAT(Error(R"({"input":"a","view":"front"})"), HasSubstr("no picture"));
  for (const char* outside : {"/x.npy", "../x.npy", "a/../../x.npy"}) {
    EXPECT_THAT(Error(std::string(R"({"input":"a","output":")") + outside + "\"}"), HasSubstr("below the output"));
  }
  EXPECT_THAT(Error(R"({"input":"a","id":"../x"})"), HasSubstr("'id'"));
  EXPECT_THAT(Error(R"({"input":"a","output":".voxelpipe/x.npy"})"), HasSubstr("batch's own"));
}

TEST_F(ManifestTest, TwoItemsWithOneFileAreAnError) {
  EXPECT_THAT(Error("{\"input\":\"d/a.glb\"}\n{\"input\":\"e/a.glb\"}"),
              StartsWith("2: the output 'a.npy' is that of line 1"));
  EXPECT_THAT(Error("{\"input\":\"a\",\"output\":\"x/./y.npy\"}\n{\"input\":\"b\",\"output\":\"x/y.npy\"}"),
              HasSubstr("line 1"));
  EXPECT_THAT(
      Error("{\"input\":\"a\",\"id\":\"i\",\"output\":\"x.npy\"}\n{\"input\":\"b\",\"id\":\"i\",\"output\":\"y.npy\"}"),
      HasSubstr("id 'i'"));
  // The second file of two targets.
  EXPECT_THAT(Error("{\"input\":\"a\",\"target\":[\"bit:or\",\"bit:and\"]}\n{\"input\":\"b\",\"output\":\"a.1.npy\"}"),
              HasSubstr("'a.1.npy' is that of line 1"));
  EXPECT_THAT(Error("{\"input\":\"a\",\"preview\":\"a.png\"}\n{\"input\":\"b\",\"output\":\"a.png\"}"),
              HasSubstr("line 1"));
}

TEST_F(ManifestTest, TheDigestKnowsWhatChangesBytesAndNothingElse) {
  const auto digest = [&](const std::string& keys) {
    return Items("{\"input\":\"a\"" + keys + "}")[0].request->digest;
  };
  const std::string plain = digest("");
  EXPECT_EQ(plain.size(), 64u);
  for (const char* same : {R"(,"backend":"cpu")", R"(,"simd":"scalar")", R"(,"threads":2)", R"(,"id":"x")"}) {
    EXPECT_EQ(digest(same), plain) << same;
  }
  for (const char* other :
       {R"(,"resolution":64)", R"(,"voxel_size":1)", R"(,"fit":"cube")", R"(,"padding":1)", R"(,"coverage":"thin")",
        R"(,"fill":"parity")", R"(,"shader":"normal")", R"(,"vertex_shader":"displace_along_normal:distance=1")",
        R"(,"target":"u8:max")", R"(,"layout":"planar")", R"(,"result":"sparse")"}) {
    EXPECT_NE(digest(other), plain) << other;
  }
}

TEST_F(ManifestTest, TheFormatGivesWhatAnItemLeavesOpen) {
  const std::string target = R"(,"target":"u8:max:shader=material_id")";
  const std::vector<BatchItem> items =
      Items("{\"input\":\"a\",\"output\":\"a.glb\"}\n{\"input\":\"a\",\"output\":\"b.npz\"}\n" +
            std::string("{\"input\":\"a\",\"output\":\"c.ply\"") + target +
            "}\n{\"input\":\"a\",\"output\":\"d.ply\",\"result\":\"dense\"" + target +
            "}\n{\"input\":\"a\",\"id\":\"e\",\"format\":\"vox\"}");
  ASSERT_EQ(items.size(), 5u);
  const auto result = [&](size_t i) { return items[i].request->request.result; };
  const auto shader = [&](size_t i) { return items[i].request->request.targets[0].shader.name; };
  EXPECT_EQ(result(0), ResultKind::kSparse);
  EXPECT_EQ(shader(0), "base_color");
  EXPECT_EQ(result(1), ResultKind::kDense);
  EXPECT_EQ(shader(1), "occupancy");
  EXPECT_EQ(result(2), ResultKind::kSparse);
  EXPECT_EQ(shader(2), "material_id");
  EXPECT_EQ(result(3), ResultKind::kDense);
  EXPECT_EQ(shader(4), "base_color");
  EXPECT_NE(items[0].request->digest, items[1].request->digest) << "other bytes";
}

// As the command line takes them; the form of an item replaces that of the defaults.
TEST_F(ManifestTest, DimsAloneReplaceAResolutionAndAVoxelSize) {
  defaults_.request.resolution = 64;
  defaults_.request.fit = "cube";
  EXPECT_EQ(Items(R"({"input":"a","dims":"4,5,6"})")[0].request->request.grid.dims, (std::array<int64_t, 3>{4, 5, 6}));
  defaults_.request = {};
  defaults_.request.dims = "4,5,6";
  const GridRequest grid = Items(R"({"input":"a","voxel_size":"0.5"})")[0].request->request.grid;
  EXPECT_FALSE(grid.dims.has_value());
  EXPECT_TRUE(grid.voxel_size.has_value());
}

TEST_F(ManifestTest, AGridLikeIsSearchedBesideTheManifestAndTheDigestHoldsItsGrid) {
  const auto write = [&](const char* name, const char* origin) {
    std::ofstream(directory_ / name) << R"({"dims":[4,3,2],"voxel_size":[1,1,0.5],"origin":)" << origin << "}";
  };
  write("a.json", "[0,0,1]");
  write("same.json", "[0,0,1]");
  write("other.json", "[0,0,2]");
  const auto item = [&](const std::string& keys) { return Items("{\"input\":\"a\"" + keys + "}")[0].request; };
  const auto first = item(R"(,"grid_like":"a.json")");
  EXPECT_EQ(first->request.grid.dims, (std::array<int64_t, 3>{4, 3, 2}));
  EXPECT_EQ(item(R"(,"grid-like":"same.json")")->digest, first->digest);
  EXPECT_EQ(item(R"(,"dims":"4,3,2","origin":"0,0,1","voxel_size":"1,1,0.5")")->digest, first->digest);
  EXPECT_NE(item(R"(,"grid_like":"other.json")")->digest, first->digest);
  EXPECT_THAT(Error(R"({"input":"a","grid_like":"a.json","resolution":4})"), HasSubstr("leave resolution out"));
  EXPECT_THAT(Error(R"({"input":"a","grid_like":"no.json"})"), HasSubstr("no.json: no such file"));
  defaults_.request.resolution = 64;
  EXPECT_EQ(item(R"(,"grid_like":"a.json")")->digest, first->digest);
  defaults_.request = RequestOptions();
  defaults_.request.grid_like = directory_ / "a.json";
  EXPECT_EQ(item("")->digest, first->digest);
  EXPECT_EQ(item(R"(,"resolution":9)")->request.grid.resolution, 9);
}

TEST_F(ManifestTest, AxesAndAClipAreOptionsOfItems) {
  const auto item = [&](const std::string& keys) { return Items("{\"input\":\"a\"" + keys + "}")[0].request; };
  EXPECT_EQ(item(R"(,"axes":"x,z,-y")")->request.vertex_shader.name, "transform");
  EXPECT_NE(item(R"(,"axes":"x,z,-y")")->digest, item("")->digest);
  const auto clipped = item(R"(,"clip":[0,0,0,1,2,4],"resolution":8)");
  EXPECT_EQ(clipped->request.grid.dims, (std::array<int64_t, 3>{2, 4, 8}));
  EXPECT_NE(clipped->digest, item(R"(,"resolution":8)")->digest);
  EXPECT_THAT(Error(R"({"input":"a","clip":"0,0,0,1,1,0"})"), HasSubstr("1: clip: "));
  defaults_.request.dims = "1,1,1";
  defaults_.request.origin = "0,0,0";
  defaults_.request.voxel_size = "0.5";
  EXPECT_EQ(item(R"(,"clip":[0,0,0,1,2,4])")->request.grid.dims, (std::array<int64_t, 3>{2, 4, 8}));
  defaults_.request = RequestOptions();
  defaults_.request.clip = "0,0,0,1,1,1";
  EXPECT_EQ(item(R"(,"dims":"1,1,3","origin":"0,0,0","voxel_size":1)")->request.grid.dims,
            (std::array<int64_t, 3>{1, 1, 3}));
}

TEST_F(ManifestTest, StandardInputIsNoInput) {
  EXPECT_THAT(Error(R"({"input":"-"})"), HasSubstr("name a file"));
}

TEST_F(ManifestTest, AManifestThatIsNotThereIsNotFound) {
  EXPECT_TRUE(absl::IsNotFound(ManifestReader::Open(directory_ / "none", defaults_).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(ManifestReader::Open(directory_.path().string(), defaults_).status()));
}

// A list of a million lines begins at once: what is wrong beyond the first lines is found when it is reached.
TEST_F(ManifestTest, TheFirstLinesAreCheckedAtOnceAndFurtherOnesAsTheyAreReached) {
  const auto lines = [](size_t count) {
    std::string text;
    for (size_t i = 0; i < count; ++i) text += "{\"input\":\"a\",\"id\":" + std::to_string(i) + "}\n";
    return text;
  };
  constexpr size_t kChecked = ManifestReader::kCheckedLines;
  EXPECT_THAT(Error(lines(kChecked - 1) + "{"), StartsWith(std::to_string(kChecked) + ": no JSON"));
  Write(lines(kChecked) + "{}\n{\"input\":\"b\"}");
  absl::StatusOr<ManifestReader> manifest = ManifestReader::Open(path_, defaults_);
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  for (size_t i = 0; i < kChecked; ++i) {
    const absl::StatusOr<std::optional<BatchItem>> item = manifest->Next();
    ASSERT_TRUE(item.ok()) << item.status();
    ASSERT_EQ((*item)->number, i);
  }
  for (int i = 0; i < 2; ++i) {
    const absl::Status status = manifest->Next().status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(":" + std::to_string(kChecked + 1) + ": 'input' is missing"));
  }
  // Among all lines no two have one output, however far apart.
  Write(lines(kChecked + 5) + "{\"input\":\"x/7.glb\"}");
  EXPECT_THAT(std::string(Read().status().message()), HasSubstr("the output '7.npy' is that of line 8 already"));
}

TEST_F(ManifestTest, AShardKnowsTheNamesOfTheOthers) {
  const std::string list = "{\"input\":\"a\"}\n\n{\"input\":\"b\"}\n{\"input\":\"c\"}\n{\"input\":\"d\"}\n";
  const std::vector<BatchItem> items = Items(list, {1, 2});
  ASSERT_EQ(items.size(), 2u);
  EXPECT_EQ(items[0].id, "b");
  EXPECT_EQ(items[0].line, 3u);
  EXPECT_EQ(items[0].number, 1u);
  EXPECT_EQ(items[1].number, 3u);
  Write(list + "{\"input\":\"b\"}");  // of the other shard than the first b
  EXPECT_THAT(std::string(Read({0, 2}).status().message()), HasSubstr("'b.npy' is that of line 3"));
}

TEST_F(ManifestTest, AListFromAPipeIsReadToItsEnd) {
  const std::string pipe = directory_ / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  std::thread writer([&] { std::ofstream(pipe) << "{\"input\":\"a\"}\n{\"input\":\"b\"}\n"; });
  absl::StatusOr<ManifestReader> manifest = ManifestReader::Open(pipe, defaults_);
  writer.join();
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  EXPECT_EQ((*manifest->Next())->input, directory_ / "a");
  EXPECT_EQ(manifest->Scan()->items, 2u);
}

TEST_F(ManifestTest, AScanCountsItemsAndKnowsTheirLines) {
  Write("\xEF\xBB\xBF{\"input\":\"a\"}\n \t\r\n{no JSON}");
  std::vector<std::string> seen;
  const auto facts = ScanManifest(path_, [&](size_t line, size_t item, std::string_view text) {
    seen.push_back(std::to_string(line) + " " + std::to_string(item) + " " + std::string(text));
  });
  ASSERT_TRUE(facts.ok()) << facts.status();
  EXPECT_EQ(facts->items, 2u);
  EXPECT_THAT(seen, ::testing::ElementsAre("1 0 {\"input\":\"a\"}", "3 1 {no JSON}"));
  Write("{\"input\":\"a\"}\n\n{no JSON}\n");
  EXPECT_EQ(ScanManifest(path_)->sha256, facts->sha256) << "the same items";
  Write("{\"input\":\"a\"}\n{no JSON}\n");
  EXPECT_NE(ScanManifest(path_)->sha256, facts->sha256) << "another line";
}

}  // namespace
}  // namespace voxelpipe::cli
