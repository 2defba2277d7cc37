// The loader never touches the file system or the network: it runs in a child process whose kernel kills it for trying.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstddef>
#include <functional>

#include "base/memory_budget.h"
#include "load/loader.h"
#include "support/meshes/glb_builder.h"

namespace voxelpipe {
namespace {

using testing::ByteVector;
using testing::GlbBuilder;

constexpr int kFilterMissing = 99;

// Every system call by which a process could look at a file, or open a socket.
const std::vector<long> kForbidden = {
    SYS_openat,  SYS_openat2, SYS_faccessat, SYS_newfstatat, SYS_statx,   SYS_readlinkat,        SYS_socket,
    SYS_connect, SYS_execve,  SYS_unlinkat,  SYS_renameat2,  SYS_mkdirat, SYS_name_to_handle_at,
#ifdef SYS_open
    SYS_open,    SYS_creat,   SYS_access,    SYS_stat,       SYS_lstat,   SYS_readlink,
#endif
};

bool ForbidFiles() {
  std::vector<sock_filter> program = {BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr))};
  for (const long call : kForbidden) {
    program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<uint32_t>(call), 0, 1));
    program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS));
  }
  program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
  const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
  return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) == 0;
}

// Runs `body` in a child without files. Its exit status as waitpid gives it.
int RunWithoutFiles(const std::function<int()>& body) {
  const pid_t child = fork();
  if (child == 0) {
    if (!ForbidFiles()) _exit(kFilterMissing);
    _exit(body());
  }
  int status = 0;
  EXPECT_EQ(waitpid(child, &status, 0), child);
  return status;
}

bool FilterMissing() {
  const int status = RunWithoutFiles([] { return 0; });
  return WIFEXITED(status) && WEXITSTATUS(status) == kFilterMissing;
}

GlbBuilder WithUris(const std::string& buffer_uri, const std::string& image_uri) {
  GlbBuilder builder;
  builder.Scene({builder.Node({{"mesh", builder.Mesh(builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}))}})});
  builder.doc["buffers"] = {{{"byteLength", builder.bin.size()}}};
  if (!buffer_uri.empty()) builder.doc["buffers"][0]["uri"] = buffer_uri;
  builder.doc["images"] = {{{"uri", image_uri}}};
  builder.doc["textures"] = {{{"source", 0}}};
  builder.doc["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  return builder;
}

TEST(FileAccess, TheCageWorks) {
  if (FilterMissing()) GTEST_SKIP() << "this kernel has no seccomp filters";
  const int status = RunWithoutFiles([] { return open("/etc/hostname", O_RDONLY) >= 0 ? 1 : 2; });
  EXPECT_TRUE(WIFSIGNALED(status)) << "a child that opens a file is killed";
}

TEST(FileAccess, LoadingOpensNothing) {
  if (FilterMissing()) GTEST_SKIP() << "this kernel has no seccomp filters";
  const std::vector<std::string> uris = {"/etc/hostname",
                                         "file:///etc/hostname",
                                         "../../../etc/hostname",
                                         "a.bin",
                                         "%2Fetc%2Fhostname",
                                         "http://127.0.0.1:9/a.bin",
                                         "/etc",
                                         "//server/share/a.bin",
                                         "data.bin?x=/etc/hostname",
                                         "..",
                                         "\\\\server\\share\\data.bin",
                                         ""};
  std::vector<ByteVector> inside, outside;
  for (const std::string& uri : uris) {
    inside.push_back(WithUris("", uri).Glb());
    const std::string text = WithUris(uri, uri).doc.dump();
    outside.push_back(uri.empty() ? ByteVector{} : ByteVector(text.begin(), text.end()));
  }
  (void)DefaultMemory();  // reads once how much memory there is
  const int status = RunWithoutFiles([&] {
    for (const ByteVector& bytes : inside) {
      if (!LoadScene(bytes).ok()) return 1;  // a missing image costs no geometry
    }
    for (const ByteVector& bytes : outside) {
      if (LoadScene(bytes).ok()) return 2;  // a buffer outside the document is refused
    }
    return 0;
  });
  ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status) << " for a forbidden system call";
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(FileAccess, ABufferThatNamesAFileThatExistsIsRefusedByName) {
  const std::string text = WithUris("/etc/hostname", "").doc.dump();
  const absl::Status status = LoadScene(ByteVector(text.begin(), text.end())).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("buffer 0: the URI '/etc/hostname' is not read"));
}

}  // namespace
}  // namespace voxelpipe
