#include "observe/unix_socket.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <utility>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "support/resources/temporary_directory.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using testing::TemporaryDirectory;

sockaddr_un AddressOf(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  EXPECT_LT(path.size(), sizeof address.sun_path);
  std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
  return address;
}

// A listening socket, as gRPC makes it; it is closed, but not removed, at its end.
class Listener {
 public:
  explicit Listener(const std::string& path) : fd_(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const sockaddr_un address = AddressOf(path);
    EXPECT_EQ(bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0) << path;
    EXPECT_EQ(listen(fd_, 8), 0);
  }
  ~Listener() { close(fd_); }
  Listener(const Listener&) = delete;
  // True if a connection reaches this one.
  bool IsAt(const std::string& path) const {
    const int client = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const sockaddr_un address = AddressOf(path);
    const bool connected = connect(client, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    const int accepted = connected ? accept4(fd_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC) : -1;
    if (accepted >= 0) close(accepted);
    close(client);
    return accepted >= 0;
  }

 private:
  int fd_;
};

// A server's socket and its name.
struct Served {
  std::unique_ptr<Listener> listener;
  std::unique_ptr<UnixSocket> name;
};

absl::StatusOr<Served> Serve(const std::string& path) {
  auto name = UnixSocket::Prepare("unix:" + path);
  if (!name.ok()) return name.status();
  auto listener = std::make_unique<Listener>(UnixPathOf((*name)->private_address()));
  if (absl::Status s = (*name)->Publish(); !s.ok()) return s;
  return Served{std::move(listener), *std::move(name)};
}

class UnixSocketTest : public ::testing::Test {
 protected:
  size_t FileCount() const { return directory_.FileCount(); }

  TemporaryDirectory directory_;
  const std::string path_ = directory_ / "socket";
};

TEST_F(UnixSocketTest, ItIsAtItsPathWhileItServesAndNothingElseIsThere) {
  {
    const absl::StatusOr<Served> served = Serve(path_);
    ASSERT_TRUE(served.ok()) << served.status();
    EXPECT_TRUE(served->listener->IsAt(path_));
    EXPECT_EQ(FileCount(), 1u);
  }
  EXPECT_EQ(FileCount(), 0u);
  { const auto prepared = UnixSocket::Prepare("unix:" + path_); }
  EXPECT_EQ(FileCount(), 0u);
}

TEST_F(UnixSocketTest, ASecondServerIsRefusedAndTheFirstStays) {
  const absl::StatusOr<Served> first = Serve(path_);
  ASSERT_TRUE(first.ok()) << first.status();
  const absl::Status second = Serve(path_).status();
  EXPECT_TRUE(absl::IsUnavailable(second));
  EXPECT_EQ(second.message(), "cannot listen on unix:" + path_ + ": a server listens there");
  EXPECT_TRUE(first->listener->IsAt(path_));
}

TEST_F(UnixSocketTest, OfTwoThatStartTogetherOneServes) {
  for (const bool abandoned : {false, true}) {
    if (abandoned) {
      const Listener killed(path_);
    }
    auto one = UnixSocket::Prepare("unix:" + path_), two = UnixSocket::Prepare("unix:" + path_);
    ASSERT_TRUE(one.ok() && two.ok()) << one.status() << two.status();
    const Listener first(UnixPathOf((*one)->private_address())), second(UnixPathOf((*two)->private_address()));
    EXPECT_TRUE((*one)->Publish().ok());
    EXPECT_THAT(std::string((*two)->Publish().message()), HasSubstr("a server listens there"));
    EXPECT_TRUE(first.IsAt(path_));
    *two = nullptr;
    EXPECT_TRUE(first.IsAt(path_)) << "the one that was refused ended";
    EXPECT_EQ(FileCount(), 1u);
  }
}

TEST_F(UnixSocketTest, OneThatAKilledServerLeftIsReplaced) {
  { const Listener killed(path_); }
  ASSERT_TRUE(fs::is_socket(path_));
  const absl::StatusOr<Served> served = Serve(path_);
  ASSERT_TRUE(served.ok()) << served.status();
  EXPECT_TRUE(served->listener->IsAt(path_));
  EXPECT_EQ(FileCount(), 1u);
}

TEST_F(UnixSocketTest, AnotherServersSocketIsNotRemovedAtTheEnd) {
  absl::StatusOr<Served> first = Serve(path_);
  ASSERT_TRUE(first.ok()) << first.status();
  fs::remove(path_);
  const absl::StatusOr<Served> second = Serve(path_);
  ASSERT_TRUE(second.ok()) << second.status();
  *first = Served();
  EXPECT_TRUE(second->listener->IsAt(path_));
}

TEST_F(UnixSocketTest, WhatIsNoSocketIsLeftAlone) {
  std::ofstream(path_) << "someone's";
  EXPECT_THAT(std::string(Serve(path_).status().message()), HasSubstr("something other than a socket"));
  EXPECT_EQ(fs::file_size(path_), 9u);
  fs::remove(path_);
  fs::create_symlink(directory_ / "elsewhere", path_);
  EXPECT_THAT(std::string(Serve(path_).status().message()), HasSubstr("something other than a socket"));
  EXPECT_TRUE(fs::is_symlink(path_));
  EXPECT_THAT(std::string(Serve(directory_ / "no folder/socket").status().message()), HasSubstr("No such file"));
}

TEST_F(UnixSocketTest, ThePathMayTakeAllBytesThatASocketHas) {
  const std::string path = directory_ / std::string(kMaxUnixPathBytes - std::string(directory_ / "").size(), 's');
  ASSERT_EQ(path.size(), kMaxUnixPathBytes);
  const absl::StatusOr<Served> served = Serve(path);
  ASSERT_TRUE(served.ok()) << served.status();
  EXPECT_TRUE(served->listener->IsAt(path));
  EXPECT_FALSE(Serve(path).ok());
}

TEST(UnixPathTest, IsReadAsGrpcReadsIt) {
  EXPECT_EQ(UnixPathOf("unix:/a/b"), "/a/b");
  EXPECT_EQ(UnixPathOf("unix:a%20b%2Fc"), "a b/c");
  EXPECT_EQ(UnixPathOf("unix:100%/%zz%4"), "100%/%zz%4");
  EXPECT_EQ(UnixPathOf("unix:"), "");
}

}  // namespace
}  // namespace voxelpipe
