// In processes of their own: what EnterSandbox takes does not come back.
#include "isolate/sandbox.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <string>
#include <thread>

#include <tbb/parallel_for.h>

#include "gtest/gtest.h"
#include "isolate/mesh_fields.h"
#include "support/meshes/compressed_meshes.h"
#include "support/resources/temporary_directory.h"

namespace voxelpipe {
namespace {

// The exit code of a child that runs `body`; 128 + signal.
template <typename Body>
int InChild(Body body) {
  const pid_t pid = fork();
  if (pid == 0) _exit(body());
  int status = 0;
  waitpid(pid, &status, 0);
  return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

// 0 where the kernel refuses all of it, else a number that tells which it did not. `file`: a name that is free.
int TryWhatIsForbidden(const char* file) {
  const auto refused = [](long result) { return result == -1 && errno == EPERM; };  // NOLINT(google-runtime-int)
  if (!refused(open("/etc/hostname", O_RDONLY))) return 1;
  if (!refused(open(file, O_WRONLY | O_CREAT, 0600))) return 2;
  if (!refused(socket(AF_INET, SOCK_STREAM, 0))) return 3;
  if (!refused(socket(AF_UNIX, SOCK_STREAM, 0))) return 4;
  if (!refused(fork())) return 5;
  char* const nothing[] = {nullptr};
  if (!refused(execve("/bin/true", nothing, nothing))) return 6;
  if (!refused(kill(getppid(), 0))) return 7;
  if (!refused(ptrace(PTRACE_ATTACH, getppid(), nullptr, nullptr))) return 8;
  iovec here{}, there{};
  if (!refused(process_vm_readv(getppid(), &here, 1, &there, 1, 0))) return 9;
  if (!refused(prctl(PR_SET_DUMPABLE, 1))) return 10;
  if (mmap(nullptr, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) != MAP_FAILED) return 11;
  void* const page = mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (page == MAP_FAILED) return 12;
  if (!refused(mprotect(page, 4096, PROT_READ | PROT_EXEC))) return 13;
  if (!refused(unlink(file))) return 14;
  if (!refused(memfd_create("x", 0))) return 15;
  return 0;
}

TEST(SandboxTest, TheKernelRefusesAllButMemoryThreadsAndOpenDescriptors) {
  if (IsSanitizedBuild()) GTEST_SKIP() << "sanitizers use what is refused";
  const testing::TemporaryDirectory directory;
  const std::string file = directory / "file";
  EXPECT_EQ(InChild([&] { return EnterSandbox().ok() ? TryWhatIsForbidden(file.c_str()) : 100; }), 0);
  EXPECT_NE(InChild([&] { return TryWhatIsForbidden(file.c_str()); }), 0) << "without it, some of it works";
}

TEST(SandboxTest, ThreadsThatExistAlreadyAreBoundToo) {
  if (IsSanitizedBuild()) GTEST_SKIP() << "sanitizers use what is refused";
  const testing::TemporaryDirectory directory;
  const std::string file = directory / "file";
  EXPECT_EQ(InChild([&] {
              int ends[2];
              if (pipe(ends) != 0) return 100;
              int outcome = 101;
              std::thread before([&] {
                char byte = 0;
                if (read(ends[0], &byte, 1) == 1) outcome = TryWhatIsForbidden(file.c_str());
              });
              const bool entered = EnterSandbox().ok();
              if (write(ends[1], "x", 1) != 1) return 102;
              before.join();
              return entered ? outcome : 103;
            }),
            0);
}

TEST(SandboxTest, MeshesLoadAndThreadsStartInIt) {
  if (IsSanitizedBuild()) GTEST_SKIP() << "sanitizers use what is refused";
  const testing::Shape shape = testing::TorusShape(100, 100);
  const std::vector<testing::ByteVector> files = {testing::DracoFile(shape), testing::MeshoptGlb(shape),
                                                  testing::TexturedQuadGlb(), testing::JpegQuadGlb(200, 100)};
  EXPECT_EQ(InChild([&] {
              if (!EnterSandbox().ok()) return 100;
              std::thread late([] {});
              late.join();
              const JobContext job;
              for (const auto& file : files) {
                if (!LoadMeshFor(job, file, {MeshFormat::kAuto, {true, true, true}, {}}).ok()) return 101;
              }
              try {
                throw std::bad_alloc();
              } catch (const std::bad_alloc&) {
                return 0;
              }
              return 102;
            }),
            0);
}

TEST(SandboxTest, AbortEndsTheProcess) {
  if (IsSanitizedBuild()) GTEST_SKIP() << "sanitizers use what is refused";
  EXPECT_EQ(InChild([]() -> int {
              if (!EnterSandbox().ok()) return 100;
              std::abort();
            }),
            128 + SIGABRT);
}

TEST(SandboxTest, AProcessIsBoundFromOutside) {
  if (IsSanitizedBuild()) GTEST_SKIP() << "sanitizers need terabytes";
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t pid = fork();
  if (pid == 0) {
    char byte = 0;
    if (read(ends[0], &byte, 1) != 1) _exit(100);
    void* const large = mmap(nullptr, size_t{1} << 30, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (large != MAP_FAILED) _exit(101);
    volatile uint64_t spin = 0;
    while (true) spin = spin + 1;
  }
  EXPECT_GT(AddressSpaceBytes(pid), 0u);
  BoundProcess(pid, AddressSpaceBytes(pid) + (uint64_t{512} << 20), 0);
  ASSERT_EQ(write(ends[1], "x", 1), 1);
  int status = 0;
  waitpid(pid, &status, 0);
  EXPECT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(WTERMSIG(status), SIGXCPU);
  close(ends[0]);
  close(ends[1]);
}

}  // namespace
}  // namespace voxelpipe
