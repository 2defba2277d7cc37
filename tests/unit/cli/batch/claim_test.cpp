// Which run has an item: runs of one process, of one that was killed, and of other hosts.
#include "batch/claim.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <barrier>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "batch/done_record.h"
#include "encode/atomic_file.h"
#include "support/resources/temporary_directory.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::TemporaryDirectory;
using ::testing::UnorderedElementsAre;

class ClaimTest : public ::testing::Test {
 protected:
  BatchItem Item(const std::string& id, const std::string& more = "") {
    absl::StatusOr<BatchItem> item =
        ItemParser("/", defaults_).Parse(1, R"({"input":"a","id":")" + id + "\"" + more + "}");
    EXPECT_TRUE(item.ok()) << item.status();
    return *std::move(item);
  }
  RunPresence Begin() {
    absl::StatusOr<RunPresence> run = RunPresence::Begin(out_);
    EXPECT_TRUE(run.ok()) << run.status();
    return *std::move(run);
  }
  std::optional<Claim> Take(const BatchItem& item, const RunPresence& run) {
    absl::StatusOr<std::optional<Claim>> claim = Claim::Take(out_, item, run);
    EXPECT_TRUE(claim.ok()) << claim.status();
    return claim.ok() ? *std::move(claim) : std::nullopt;
  }
  // Every name below the output directory, but those of directories.
  std::vector<std::string> Names() {
    std::vector<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(out_)) {
      if (entry.is_symlink() || !entry.is_directory()) names.push_back(entry.path().lexically_relative(out_));
    }
    return names;
  }
  // The file of a run on another host, renewed so long before now.
  std::string RunElsewhere(std::chrono::seconds ago) {
    const std::string id = "0123456789abcdef0123456789abcdef";
    const fs::path file = fs::path(out_) / ".voxelpipe/.voxelpipe" / id;
    fs::create_directories(file.parent_path());
    std::ofstream(file) << R"({"host":"elsewhere","space":"another","process":1,"start":"5"})";
    fs::last_write_time(file, fs::last_write_time(file) - ago);
    return id;
  }
  void ClaimBy(const std::string& id, const BatchItem& item) {
    fs::create_directories(fs::path(ClaimPath(out_, item)).parent_path());
    fs::create_symlink(id, ClaimPath(out_, item));
  }

  TemporaryDirectory directory_;
  const std::string out_ = directory_ / "out";
  const ManifestDefaults defaults_;
};

TEST_F(ClaimTest, OneRunAtATimeHasAnItem) {
  const BatchItem item = Item("sub/a"), other = Item("b");
  const RunPresence first = Begin(), second = Begin();
  EXPECT_NE(first.id(), second.id());
  {
    const std::optional<Claim> claim = Take(item, first);
    ASSERT_TRUE(claim.has_value());
    EXPECT_FALSE(Take(item, second).has_value());
    EXPECT_TRUE(Take(other, second).has_value());
  }
  EXPECT_TRUE(Take(item, second).has_value());
}

TEST_F(ClaimTest, ARunLeavesNothing) {
  {
    const RunPresence run = Begin();
    const std::optional<Claim> claim = Take(Item("a"), run);
    EXPECT_EQ(Names().size(), 2u);
  }
  EXPECT_THAT(Names(), IsEmpty());
  EXPECT_TRUE(fs::is_empty(out_ + "/.voxelpipe"));
}

TEST_F(ClaimTest, AKilledRunOfThisHostLosesItsItemsAtOnce) {
  const BatchItem item = Item("a");
  const pid_t child = fork();
  if (child == 0) {
    const absl::StatusOr<RunPresence> run = RunPresence::Begin(out_);
    const absl::StatusOr<std::optional<Claim>> claim = Claim::Take(out_, item, *run);
    kill(getpid(), SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  ASSERT_EQ(Names().size(), 2u);
  {
    const RunPresence run = Begin();
    EXPECT_EQ(Names().size(), 2u) << "the dead run's file goes, this run's comes";
    EXPECT_TRUE(Take(item, run).has_value());
  }
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(ClaimTest, ARunOnAnotherHostIsAliveWhileItsFileIsRenewed) {
  const BatchItem item = Item("a");
  const RunPresence run = Begin();
  const std::string id = RunElsewhere(RunPresence::kLease - std::chrono::seconds(20));
  ClaimBy(id, item);
  EXPECT_FALSE(Take(item, run).has_value());
  RunElsewhere(RunPresence::kLease + std::chrono::seconds(20));
  EXPECT_TRUE(Take(item, run).has_value());
  fs::remove(fs::path(out_) / ".voxelpipe/.voxelpipe" / id);
  ClaimBy(id, item);
  EXPECT_TRUE(Take(item, run).has_value()) << "a run without a file has ended";
}

TEST_F(ClaimTest, ARunRenewsItsFileAndMakesItAgain) {
  const RunPresence run = Begin();
  const fs::path file = fs::path(out_) / ".voxelpipe/.voxelpipe" / run.id();
  const auto now = fs::last_write_time(file);
  fs::last_write_time(file, now - std::chrono::hours(1));
  run.Beat();
  EXPECT_GE(fs::last_write_time(file), now);
  fs::remove(file);
  run.Beat();
  EXPECT_TRUE(fs::exists(file));
}

// Several runs find the claim of a dead one: those that do not get the item leave the files of the one that does.
TEST_F(ClaimTest, ARunThatTakesOverKeepsItsFiles) {
  const BatchItem item = Item("a");
  std::vector<RunPresence> runs;
  for (int i = 0; i < 4; ++i) runs.push_back(Begin());
  for (int round = 0; round < 300; ++round) {
    ClaimBy("no run", item);
    std::barrier start(int(runs.size()));
    std::atomic<int> claims{0}, lost{0};
    std::vector<std::thread> threads;
    for (const RunPresence& run : runs) {
      threads.emplace_back([&] {
        start.arrive_and_wait();
        const absl::StatusOr<std::optional<Claim>> claim = Claim::Take(out_, item, run);
        const std::string file = AtomicFile::TemporaryName(out_ + "/a.npy");
        if (claim.ok() && claim->has_value()) {
          ++claims;
          std::ofstream(file) << "half";
        }
        start.arrive_and_wait();  // all have asked
        if (claim.ok() && claim->has_value() && !fs::remove(file)) ++lost;
        start.arrive_and_wait();
      });
    }
    for (std::thread& thread : threads) thread.join();
    ASSERT_GE(claims, 1);
    if (claims == 1) {  // two may have it if the claim was aside for a moment; they then write the same bytes
      ASSERT_EQ(lost, 0) << "round " << round;
    }
    fs::remove(ClaimPath(out_, item));
  }
}

TEST_F(ClaimTest, IsTakenByOthersThatAreAlive) {
  const BatchItem item = Item("a");
  const RunPresence first = Begin(), second = Begin();
  EXPECT_FALSE(Claim::IsTaken(out_, item, second));
  {
    const std::optional<Claim> claim = Take(item, first);
    EXPECT_TRUE(Claim::IsTaken(out_, item, second));
    EXPECT_FALSE(Claim::IsTaken(out_, item, first));
  }
  ClaimBy("no run", item);
  EXPECT_FALSE(Claim::IsTaken(out_, item, second)) << "of a dead run";
}

TEST_F(ClaimTest, LeftoversOfADeadRunsItemGoAndNoOthers) {
  const BatchItem item = Item("a", R"(,"target":["bit:or","bit:and"],"preview":"p/a.png")");
  const RunPresence run = Begin();
  ClaimBy("no run", item);
  fs::create_directories(out_ + "/p");
  for (const char* name : {"/a.0.npy.part-1-2", "/a.1.npy.part-77-0", "/.voxelpipe/a.npy.json.part-1-2",
                           "/p/a.png.part-1-2", "/.voxelpipe/a.npy.claim.part-1-2"}) {
    std::ofstream(out_ + name) << "half";
  }
  for (const char* name : {"/b.npy.part-1-2", "/a.0.npy.part-", "/a.0.npy.part-1-2.txt", "/notes.part-1-1"}) {
    std::ofstream(out_ + name) << "someone's";
  }
  ASSERT_TRUE(Take(item, run).has_value());
  EXPECT_THAT(Names(), UnorderedElementsAre("b.npy.part-1-2", "a.0.npy.part-", "a.0.npy.part-1-2.txt", "notes.part-1-1",
                                            ".voxelpipe/.voxelpipe/" + run.id()));
}

TEST_F(ClaimTest, TheClaimOfADeadRunOnADoneItemGoes) {
  const BatchItem item = Item("a");
  const RunPresence run = Begin(), other = Begin();
  ClaimBy(other.id(), item);
  Claim::RemoveDead(out_, item, run);
  EXPECT_TRUE(fs::is_symlink(ClaimPath(out_, item))) << "of a run that is alive";
  fs::remove(ClaimPath(out_, item));
  ClaimBy("0123456789abcdef0123456789abcdef", item);
  Claim::RemoveDead(out_, item, run);
  EXPECT_FALSE(fs::is_symlink(ClaimPath(out_, item)));
}

TEST_F(ClaimTest, SomethingElseInThePlaceOfAClaimIsNamed) {
  const BatchItem item = Item("a");
  const RunPresence run = Begin();
  fs::create_directories(ClaimPath(out_, item));
  const absl::Status status = Claim::Take(out_, item, run).status();
  EXPECT_THAT(std::string(status.message()), HasSubstr("a.npy.claim' is in the place of a claim"));
}

// Who may write to the directory could make a run create a file anywhere.
TEST_F(ClaimTest, ALinkOutOfTheDirectoryIsRefusedByName) {
  fs::create_directories(directory_ / "elsewhere");
  for (const char* link : {"/.voxelpipe", "/.voxelpipe/.voxelpipe"}) {
    fs::create_directories(fs::path(out_ + link).parent_path());
    fs::create_directory_symlink(directory_ / "elsewhere", out_ + link);
    const absl::Status status = RunPresence::Begin(out_).status();
    EXPECT_TRUE(absl::IsPermissionDenied(status)) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("is a link that leads out of"));
    fs::remove(out_ + link);
  }
  for (const auto& entry : fs::recursive_directory_iterator(directory_ / "elsewhere")) {
    EXPECT_TRUE(entry.is_directory()) << entry.path();
  }
}

}  // namespace
}  // namespace voxelpipe::cli
