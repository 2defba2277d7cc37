#include "encode/atomic_directory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "encode/atomic_file.h"
#include "sample_results.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using testing::TemporaryDirectory;

constexpr char kMark[] = "mark";

absl::Status Write(const std::string& path, const std::string& text) {
  absl::StatusOr<AtomicDirectory> directory = AtomicDirectory::Create(path, kMark);
  if (!directory.ok()) return directory.status();
  const std::span<const uint8_t> bytes(reinterpret_cast<const uint8_t*>(text.data()), text.size());
  for (const std::string& name : {std::string(kMark), "deep/" + text}) {
    if (absl::Status s = directory->WriteFile(name, bytes, nullptr); !s.ok()) return s;
  }
  return directory->Commit();
}

TEST(AtomicDirectory, AppearsWholeAndReplacesAnEarlierOne) {
  const TemporaryDirectory top;
  for (const char* text : {"first", "second"}) {
    ASSERT_TRUE(Write(top / "d/", text).ok());
    EXPECT_EQ(top.FileCount(), 1u) << "no temporary name is left";
    EXPECT_EQ(testing::ReadFile(top / "d/mark").size(), std::string(text).size());
    EXPECT_TRUE(fs::exists(top / (std::string("d/deep/") + text)));
  }
  EXPECT_FALSE(fs::exists(top / "d/deep/first"));
}

TEST(AtomicDirectory, IsNotThereWithoutCommit) {
  const TemporaryDirectory top;
  {
    const absl::StatusOr<AtomicDirectory> directory = AtomicDirectory::Create(top / "d", kMark);
    ASSERT_TRUE(directory.ok());
    ASSERT_TRUE(directory->WriteFile("a/b", {}, nullptr).ok());
    EXPECT_FALSE(fs::exists(top / "d"));
    EXPECT_EQ(AtomicFile::StemOf(fs::directory_iterator(top.path())->path().string()), top / "d");
  }
  EXPECT_EQ(top.FileCount(), 0u);
}

TEST(AtomicDirectory, ReplacesNothingElse) {
  const TemporaryDirectory top;
  fs::create_directory(top / "d");
  EXPECT_TRUE(Write(top / "d", "first").ok()) << "an empty directory";
  fs::remove(top / "d/mark");
  std::ofstream(top / "f") << "a file";
  for (const char* name : {"d", "f"}) {
    const absl::Status status = Write(top / name, "second");
    EXPECT_EQ(status.code(), absl::StatusCode::kAlreadyExists);
    EXPECT_THAT(std::string(status.message()), HasSubstr("it has no mark"));
    EXPECT_TRUE(IsOutputError(status));
  }
  EXPECT_TRUE(fs::exists(top / "d/deep/first"));
  EXPECT_EQ(Write(top / "missing/d", "x").code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(top.FileCount(), 2u);
}

TEST(AtomicDirectory, ATemporaryNameThatIsTakenIsNotUsedAndNotFollowed) {
  namespace fs = std::filesystem;
  const TemporaryDirectory directory;
  const std::string path = directory / "a.zarr", outside = directory / "outside";
  const std::string name = AtomicFile::TemporaryName(path);
  const size_t dash = name.rfind('-');
  const std::string next = name.substr(0, dash + 1) + std::to_string(std::stoull(name.substr(dash + 1)) + 1);
  fs::create_directory(outside);
  fs::create_symlink(outside, next);
  AtomicDirectory made = AtomicDirectory::Create(path, ".zattrs").value();
  ASSERT_TRUE(made.WriteFile(".zattrs", std::vector<uint8_t>{1}, nullptr).ok());
  ASSERT_TRUE(made.Commit().ok());
  EXPECT_TRUE(fs::exists(path + "/.zattrs"));
  EXPECT_TRUE(fs::is_empty(outside));
}

TEST(AtomicDirectory, FollowsALink) {
  const TemporaryDirectory top;
  ASSERT_TRUE(Write(top / "real", "first").ok());
  fs::create_directory_symlink("real", top / "link");
  ASSERT_TRUE(Write(top / "link", "second").ok());
  EXPECT_TRUE(fs::is_symlink(top / "link"));
  EXPECT_TRUE(fs::exists(top / "real/deep/second"));
}

}  // namespace
}  // namespace voxelpipe
