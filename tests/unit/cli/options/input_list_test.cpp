// Directories and patterns among the inputs.
#include "options/input_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "unit/encode/sample_results.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::TemporaryDirectory;

class InputListTest : public ::testing::Test {
 protected:
  InputListTest() {
    for (const char* file : {"m/b.glb", "m/a.GLB", "m/read.me", "m/.hidden.glb", "m/sub/c.gltf", "m/sub/deep/d.drc",
                             "m/sub/c.bin", "m/.git/e.glb", "m/what[1].glb", "empty/x.txt"}) {
      fs::create_directories((directory_.path() / file).parent_path());
      std::ofstream(directory_ / file) << "x";
    }
    fs::create_directory_symlink("..", directory_ / "m/sub/circle");
  }

  // Paths below the test's directory.
  std::vector<std::string> Paths(const std::string& typed, bool recursive = false) {
    const absl::StatusOr<InputList> list = ExpandInputs({directory_ / typed}, recursive);
    EXPECT_TRUE(list.ok()) << list.status();
    std::vector<std::string> paths;
    if (!list.ok()) return paths;
    for (const InputFile& file : list->files) {
      paths.push_back(fs::path(file.path).lexically_relative(directory_.path()).string());
    }
    return paths;
  }
  std::vector<std::string> Names(const std::string& typed, bool recursive = false) {
    const InputList list = ExpandInputs({directory_ / typed}, recursive).value();
    std::vector<std::string> names;
    for (const InputFile& file : list.files) names.push_back(file.name);
    return names;
  }
  std::string Error(const std::vector<std::string>& typed, bool recursive = false) {
    return std::string(ExpandInputs(typed, recursive).status().message());
  }

  TemporaryDirectory directory_;
};

TEST_F(InputListTest, FilesAreTakenAsTheyAreAndNamedByTheirStems) {
  const InputList list = ExpandInputs({"x/a.b.glb", "-", "missing"}, false).value();
  ASSERT_EQ(list.files.size(), 3u);
  EXPECT_EQ(list.files[0].path, "x/a.b.glb");
  EXPECT_EQ(list.files[0].name, "a.b");
  EXPECT_EQ(list.files[1].name, "stdin");
  EXPECT_FALSE(list.open_ended);
}

TEST_F(InputListTest, ADirectoryGivesItsMeshesInOrder) {
  EXPECT_THAT(Paths("m"), ElementsAre("m/a.GLB", "m/b.glb", "m/what[1].glb"));
  EXPECT_THAT(Paths("m/"), ElementsAre("m/a.GLB", "m/b.glb", "m/what[1].glb"));
  EXPECT_TRUE(ExpandInputs({directory_ / "m"}, false)->open_ended);
}

TEST_F(InputListTest, RecursiveLooksBelowAndKeepsFoldersInNames) {
  EXPECT_THAT(Paths("m", true), ElementsAre("m/a.GLB", "m/b.glb", "m/sub/c.gltf", "m/sub/deep/d.drc", "m/what[1].glb"));
  EXPECT_THAT(Names("m", true), ElementsAre("a", "b", "sub/c", "sub/deep/d", "what[1]"));
}

TEST_F(InputListTest, PatternsMatchWithinNames) {
  EXPECT_THAT(Paths("m/?.glb"), ElementsAre("m/b.glb"));
  EXPECT_THAT(Paths("m/*.glb"), ElementsAre("m/b.glb", "m/what[1].glb"));
  EXPECT_THAT(Paths("m/*/c.*"), ElementsAre("m/sub/c.bin", "m/sub/c.gltf"));
  EXPECT_THAT(Paths("m/[ab].*"), ElementsAre("m/a.GLB", "m/b.glb"));
  EXPECT_THAT(Paths("m/.*.glb"), ElementsAre("m/.hidden.glb"));
}

TEST_F(InputListTest, APatternWithoutAnExtensionTakesMeshesOnly) {
  EXPECT_THAT(Paths("m/*"), ElementsAre("m/a.GLB", "m/b.glb", "m/what[1].glb"));
  EXPECT_THAT(Paths("m/s*/*"), ElementsAre("m/sub/c.gltf"));
}

TEST_F(InputListTest, TwoAsterisksMatchAnyDirectoriesWithoutCircles) {
  EXPECT_THAT(Paths("m/**/*.gl*"), ElementsAre("m/b.glb", "m/sub/c.gltf", "m/what[1].glb"));
  EXPECT_THAT(Paths("**/deep/*"), ElementsAre("m/sub/deep/d.drc"));
  EXPECT_THAT(Paths("m/**/**/d.drc"), ElementsAre("m/sub/deep/d.drc"));
  EXPECT_THAT(Paths("m/sub/**"), ElementsAre("m/sub/c.gltf", "m/sub/deep/d.drc"));
}

TEST_F(InputListTest, NamesOfAPatternStartBehindItsFixedPart) {
  EXPECT_THAT(Names("m/**/*.gltf"), ElementsAre("sub/c"));
  EXPECT_THAT(Names("m/sub/*.gltf"), ElementsAre("c"));
}

TEST_F(InputListTest, AFileOfThisNameIsNoPattern) {
  EXPECT_THAT(Paths("m/what[1].glb"), ElementsAre("m/what[1].glb"));
  EXPECT_FALSE(ExpandInputs({directory_ / "m/what[1].glb"}, false)->open_ended);
}

TEST_F(InputListTest, NothingFoundIsAnErrorThatNamesTheNextStep) {
  EXPECT_THAT(Error({directory_ / "empty"}), HasSubstr("--recursive also looks below it"));
  EXPECT_THAT(Error({directory_ / "empty"}, true), HasSubstr("or below it"));
  EXPECT_THAT(Error({directory_ / "m/*.obj"}), HasSubstr("no file matches"));
  EXPECT_THAT(Error({directory_ / "no/such/*.glb"}), HasSubstr("no file matches"));
  EXPECT_THAT(Error({directory_ / "m/b.glb"}, true), HasSubstr("no directory among the inputs"));
}

}  // namespace
}  // namespace voxelpipe::cli
