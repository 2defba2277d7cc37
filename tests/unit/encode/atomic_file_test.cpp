#include "encode/atomic_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <thread>

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
  EXPECT_FALSE(AtomicFile::Create(directory / "a.raw").ok());
  EXPECT_EQ(directory.FileCount(), 1u);
}

void WriteTo(const std::string& path, const std::string& text) {
  absl::StatusOr<AtomicFile> file = AtomicFile::Create(path);
  ASSERT_TRUE(file.ok()) << file.status();
  ASSERT_TRUE(file->Write({reinterpret_cast<const uint8_t*>(text.data()), text.size()}).ok());
  ASSERT_TRUE(file->Commit().ok());
}

std::string TextOf(const std::string& path) {
  const std::vector<uint8_t> bytes = ReadFile(path);
  return {bytes.begin(), bytes.end()};
}

TEST(AtomicFile, FollowsALinkAndLeavesItALink) {
  const TemporaryDirectory directory;
  std::filesystem::create_directory(directory / "real");
  std::ofstream(directory / "real/a.raw") << "old";
  std::filesystem::create_symlink("real/a.raw", directory / "one");
  std::filesystem::create_symlink("one", directory / "two");
  WriteTo(directory / "two", "new");
  EXPECT_TRUE(std::filesystem::is_symlink(directory / "two"));
  EXPECT_EQ(TextOf(directory / "real/a.raw"), "new");

  std::filesystem::create_symlink("real/b.raw", directory / "to_nothing");
  WriteTo(directory / "to_nothing", "b");
  EXPECT_EQ(TextOf(directory / "real/b.raw"), "b");

  std::filesystem::create_symlink("circle", directory / "circle");
  EXPECT_FALSE(AtomicFile::Create(directory / "circle").ok());
  EXPECT_EQ(directory.FileCount(), 5u);
}

TEST(AtomicFile, AFileThatWasThereKeepsItsMode) {
  namespace fs = std::filesystem;
  const TemporaryDirectory directory;
  for (const fs::perms mode : {fs::perms(0600), fs::perms(0664), fs::perms(0755)}) {
    std::ofstream(directory / "a.raw") << "old";
    fs::permissions(directory / "a.raw", mode);
    WriteTo(directory / "a.raw", "new");
    EXPECT_EQ(fs::status(directory / "a.raw").permissions(), mode);
    EXPECT_EQ(TextOf(directory / "a.raw"), "new");
  }
}

TEST(AtomicFile, WritesThroughAFifo) {
  const TemporaryDirectory directory;
  const std::string path = directory / "a.raw";
  ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
  std::string text(300'000, 'x');  // more than a pipe holds
  text.back() = 'y';
  std::thread writer([&] { WriteTo(path, text); });
  EXPECT_EQ(TextOf(path), text);
  writer.join();
  EXPECT_TRUE(std::filesystem::is_fifo(path));
  EXPECT_EQ(directory.FileCount(), 1u);
}

TEST(AtomicFile, AFifoWithoutAReaderIsWaitedForUntilTheJobEnds) {
  const TemporaryDirectory directory;
  ASSERT_EQ(mkfifo((directory / "a.raw").c_str(), 0600), 0);
  JobContext job;
  job.set_deadline(JobContext::Clock::now() + std::chrono::milliseconds(100));
  EXPECT_EQ(AtomicFile::Create(directory / "a.raw", &job).status().code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_TRUE(std::filesystem::is_fifo(directory / "a.raw"));
}

TEST(AtomicFile, WritesThroughADeviceAlsoBehindALink) {
  const TemporaryDirectory directory;
  std::filesystem::create_symlink("/dev/null", directory / "a.raw");
  WriteTo(directory / "a.raw", "gone");
  EXPECT_TRUE(std::filesystem::is_character_file("/dev/null"));
  EXPECT_EQ(directory.FileCount(), 1u);
}

TEST(AtomicFile, TakesTheLongestNameThatThereIs) {
  const TemporaryDirectory directory;
  // Two long names that differ at their ends only, of letters of one and of two bytes.
  for (const std::string& letter : {std::string("n"), std::string("\xc3\xa4")}) {
    std::string name;
    while (name.size() + letter.size() <= 250) name += letter;
    name.resize(250, 'x');
    const absl::StatusOr<AtomicFile> one = AtomicFile::Create(directory / (name + "1.npy"));
    const absl::StatusOr<AtomicFile> two = AtomicFile::Create(directory / (name + "2.npy"));
    ASSERT_TRUE(one.ok()) << one.status();
    ASSERT_TRUE(two.ok()) << two.status();
    EXPECT_NE(AtomicFile::TemporaryStem(name + "1.npy"), AtomicFile::TemporaryStem(name + "2.npy"));
    WriteTo(directory / (name + "3.npy"), letter);
    EXPECT_EQ(TextOf(directory / (name + "3.npy")), letter);
  }
  EXPECT_EQ(directory.FileCount(), 2u);
}

TEST(AtomicFile, AnErrorOfWritingIsKnownAsOne) {
  const TemporaryDirectory directory;
  EXPECT_TRUE(IsOutputError(AtomicFile::Create(directory / "missing/a.raw").status()));
  EXPECT_FALSE(IsOutputError(absl::InvalidArgumentError("other")));
  EXPECT_EQ(OutputErrno(AtomicFile::Create(directory / "missing/a.raw").status()), ENOENT);
  EXPECT_EQ(OutputErrno(absl::NotFoundError("other")), 0);
  EXPECT_EQ(OutputErrno(AsOutputError(absl::NotFoundError("other"))), 0);
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
  EXPECT_EQ(AtomicFile::StemOf("d/a.npy.part-123-0"), "d/a.npy");
  EXPECT_EQ(AtomicFile::StemOf("a.part-1-2.part-3-4"), "a.part-1-2");
  for (const char* other : {"a.npy", "a.part-", "a.part-1", "a.part-1-", "a.part--1", "a.part-1-2x", ".part-1-2", ""}) {
    EXPECT_EQ(AtomicFile::StemOf(other), "") << other;
  }
}

// Process ids come again, in containers at once; and a link could lead anywhere.
TEST(AtomicFile, ATemporaryNameThatIsTakenIsNotUsedAndNotFollowed) {
  namespace fs = std::filesystem;
  const TemporaryDirectory directory;
  const std::string path = directory / "a.raw", outside = directory / "outside";
  const std::string name = AtomicFile::TemporaryName(path);
  const size_t dash = name.rfind('-');
  const uint64_t number = std::stoull(name.substr(dash + 1));
  const std::string next = name.substr(0, dash + 1) + std::to_string(number + 1);
  const std::string second = name.substr(0, dash + 1) + std::to_string(number + 2);
  fs::create_symlink(outside, next);
  std::ofstream(second) << "left";
  AtomicFile file = AtomicFile::Create(path).value();
  ASSERT_TRUE(file.Write(std::vector<uint8_t>{1, 2, 3}).ok());
  ASSERT_TRUE(file.Commit().ok());
  EXPECT_EQ(ReadFile(path), (std::vector<uint8_t>{1, 2, 3}));
  EXPECT_FALSE(fs::exists(outside));
  EXPECT_TRUE(fs::is_symlink(next));
  EXPECT_EQ(ReadFile(second), (std::vector<uint8_t>{'l', 'e', 'f', 't'}));
}

TEST(AtomicFile, ItsOwnTemporaryIsOneOfThem) {
  const testing::TemporaryDirectory directory;
  for (const std::string& name : {std::string("a.npy"), std::string(251, 'n') + ".npy"}) {
    const std::string path = directory / name;
    const absl::StatusOr<AtomicFile> file = AtomicFile::Create(path);
    ASSERT_TRUE(file.ok());
    for (const auto& entry : std::filesystem::directory_iterator(directory.path())) {
      EXPECT_EQ(AtomicFile::StemOf(entry.path().string()), AtomicFile::TemporaryStem(path));
    }
    EXPECT_EQ(directory.FileCount(), 1u);
  }
}

}  // namespace
}  // namespace voxelpipe
