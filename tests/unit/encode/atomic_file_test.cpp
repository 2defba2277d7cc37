#include "encode/atomic_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sample_results.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;
using testing::ReadFile;
using testing::TemporaryDirectory;

TEST(AtomicFile, AppearsOnlyWithCommit) {
  const TemporaryDirectory directory;
  const std::string path = directory / "a.raw";
  const std::vector<uint8_t> bytes{1, 2, 3};
  {
    AtomicFile file = AtomicFile::Create(path).value();
    ASSERT_TRUE(file.Write(bytes).ok());
    EXPECT_FALSE(std::filesystem::exists(path));
    ASSERT_TRUE(file.Commit().ok());
  }
  EXPECT_EQ(ReadFile(path), bytes);
  EXPECT_EQ(directory.FileCount(), 1u);
}

TEST(AtomicFile, LeavesNothingWithoutCommitAndKeepsWhatWasThere) {
  const TemporaryDirectory directory;
  const std::string path = directory / "a.raw";
  std::ofstream(path) << "old";
  {
    AtomicFile file = AtomicFile::Create(path).value();
    ASSERT_TRUE(file.Write(std::vector<uint8_t>{1, 2, 3}).ok());
  }
  EXPECT_EQ(ReadFile(path), (std::vector<uint8_t>{'o', 'l', 'd'}));
  EXPECT_EQ(directory.FileCount(), 1u);
}

TEST(AtomicFile, NamesThePathThatCannotBeCreated) {
  const TemporaryDirectory directory;
  const std::string path = directory / "missing/a.raw";
  const absl::StatusOr<AtomicFile> file = AtomicFile::Create(path);
  ASSERT_FALSE(file.ok());
  EXPECT_THAT(std::string(file.status().message()), HasSubstr(path));
}

TEST(AtomicFile, CannotReplaceADirectory) {
  const TemporaryDirectory directory;
  std::filesystem::create_directory(directory / "a.raw");
  std::ofstream(directory / "a.raw/inside") << "x";
  {
    AtomicFile file = AtomicFile::Create(directory / "a.raw").value();
    EXPECT_FALSE(file.Commit().ok());
  }
  EXPECT_EQ(directory.FileCount(), 1u);
}

TEST(AtomicFile, StopsWithTheJob) {
  const TemporaryDirectory directory;
  JobContext job;
  job.Cancel();
  {
    AtomicFile file = AtomicFile::Create(directory / "a.raw").value();
    EXPECT_EQ(file.Write(std::vector<uint8_t>{1}, &job).code(), absl::StatusCode::kCancelled);
  }
  EXPECT_EQ(directory.FileCount(), 0u);
}

TEST(AtomicFile, KnowsTheTemporaryNamesOfKilledProcesses) {
  EXPECT_EQ(AtomicFile::FinalPath("d/a.npy.part-123-0"), "d/a.npy");
  EXPECT_EQ(AtomicFile::FinalPath("a.part-1-2.part-3-4"), "a.part-1-2");
  for (const char* other : {"a.npy", "a.part-", "a.part-1", "a.part-1-", "a.part--1", "a.part-1-2x", ".part-1-2", ""}) {
    EXPECT_EQ(AtomicFile::FinalPath(other), "") << other;
  }
}

TEST(AtomicFile, ItsOwnTemporaryIsOneOfThem) {
  const testing::TemporaryDirectory directory;
  const std::string path = directory / "a.npy";
  const absl::StatusOr<AtomicFile> file = AtomicFile::Create(path);
  ASSERT_TRUE(file.ok());
  for (const auto& entry : std::filesystem::directory_iterator(directory.path())) {
    EXPECT_EQ(AtomicFile::FinalPath(entry.path().string()), path);
  }
  EXPECT_EQ(directory.FileCount(), 1u);
}

}  // namespace
}  // namespace voxelpipe
