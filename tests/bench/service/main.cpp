// service_yardstick: the bare gRPC figures of this machine, one line a case: name, CPU us a request (both processes),
// requests/s, GB/s, CPU-s/GB.
//   service_yardstick [--seconds S] [--megabytes N] [--streams] [--tls-cert FILE --tls-key FILE]
//     --streams: only the streams of bytes, N MiB each
//   service_yardstick --rate R [--seconds S]: unary calls at random, R a second, 20 KB up and 5 KB down; latency from
//   the scheduled send times
//   service_yardstick --serve [--tls-cert FILE --tls-key FILE]
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "bench/service/bare_grpc.h"
#include "bench/service/open_loop.h"

namespace voxelpipe::bench {
namespace {

void Print(const char* name, const Measured& m) {
  std::printf("%-32s %9.1f us %10.0f /s %7.2f GB/s %6.3f CPU-s/GB (server %.3f, client %.3f)\n", name,
              m.cpu_us_per_request(), m.requests / m.seconds, m.gigabytes_per_second(),
              (m.server_cpu + m.client_cpu) / m.bytes * 1e9, m.server_cpu / m.bytes * 1e9,
              m.client_cpu / m.bytes * 1e9);
  std::fflush(stdout);
}

// A second process of this program that serves. Out: its id and port.
struct Child {
  pid_t pid = -1;
  int port = 0;
};
Child StartServer(const BareTls& tls) {
  int ends[2];
  if (pipe(ends) != 0) return {};
  Child child;
  child.pid = fork();
  if (child.pid == 0) {
    dup2(ends[1], STDOUT_FILENO);
    execl("/proc/self/exe", "service_yardstick", "--serve", "--tls-cert", tls.cert_file.c_str(), "--tls-key",
          tls.key_file.c_str(), nullptr);
    _exit(127);
  }
  close(ends[1]);
  if (FILE* in = fdopen(ends[0], "r")) {
    if (std::fscanf(in, "%d", &child.port) != 1) child.port = 0;
    std::fclose(in);
  }
  return child;
}

void EndServer(const Child& child) {
  kill(child.pid, SIGKILL);
  waitpid(child.pid, nullptr, 0);
}

void PrintOpenLoop(BareGrpc& bare, pid_t server, double rate, double seconds) {
  OpenLoopUnary(bare.channel(), server, 20'000, 5'000, rate, 0.3);  // warm
  const OpenLoop result = OpenLoopUnary(bare.channel(), server, 20'000, 5'000, rate, seconds);
  const auto ms = [](uint64_t nanoseconds) { return double(nanoseconds) * 1e-6; };
  std::printf("unary 20 KB -> 5 KB, %.0f /s at random: %.1f us CPU a request; ms: p50 %.3f, p99 %.3f, max %.3f\n", rate,
              result.measured.cpu_us_per_request(), ms(result.latency_ns.Percentile(0.5)),
              ms(result.latency_ns.Percentile(0.99)), ms(result.latency_ns.max()));
}

int Main(int argc, char** argv) {
  double seconds = 2, rate = 0;
  size_t megabytes = 1024;
  bool serve = false, only_streams = false;
  BareTls tls;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--serve") == 0) serve = true;
    if (std::strcmp(argv[i], "--streams") == 0) only_streams = true;
    if (i + 1 < argc && std::strcmp(argv[i], "--tls-cert") == 0) tls.cert_file = argv[++i];
    if (i + 1 < argc && std::strcmp(argv[i], "--tls-key") == 0) tls.key_file = argv[++i];
    if (i + 1 < argc && std::strcmp(argv[i], "--seconds") == 0) seconds = std::atof(argv[++i]);
    if (i + 1 < argc && std::strcmp(argv[i], "--rate") == 0) rate = std::atof(argv[++i]);
    if (i + 1 < argc && std::strcmp(argv[i], "--megabytes") == 0) megabytes = size_t(std::atoll(argv[++i]));
  }
  if (serve) return ServeBareGrpc(tls);
  const Child child = StartServer(tls);
  if (child.port == 0) return std::fputs("service_yardstick: no server\n", stderr), 1;
  BareGrpc bare(child.pid, child.port, tls);
  if (rate > 0) {
    PrintOpenLoop(bare, child.pid, rate, seconds);
    EndServer(child);
    return 0;
  }
  bare.RawStream(1 << 20, size_t{64} << 20);  // warm
  const size_t total = megabytes << 20;
  Print("raw stream, 256 KiB pieces", bare.RawStream(256 << 10, total));
  Print("raw stream, 1 MiB pieces", bare.RawStream(1 << 20, total));
  bare.RawStream(1 << 20, size_t{64} << 20, true);  // warm
  Print("raw stream, 1 MiB of 128 MiB", bare.RawStream(1 << 20, total, true));
  Print("raw upload, 1 MiB pieces", bare.RawUpload(1 << 20, total));
  if (only_streams) {
    EndServer(child);
    return 0;
  }
  Print("bytes stream, 1 MiB pieces", bare.BytesStream(1 << 20, total));
  Print("unary 64 B, 16 in flight", bare.Unary(64, 64, 16, seconds));
  Print("unary 20 KB -> 5 KB, 16 in flight", bare.Unary(20'000, 5'000, 16, seconds));
  Print("unary 0.3 -> 4.7 KB, threads", bare.Unary(300, 4'700, 16, seconds));
  Print("unary 0.3 -> 4.7 KB, polled", bare.UnaryPolled(300, 4'700, 16, seconds));
  Print("bidi 64 B, 16 under way", bare.Bidirectional(64, 64, 16, seconds));
  Print("bidi 20 KB -> 5 KB, 16 under way", bare.Bidirectional(20'000, 5'000, 16, seconds));
  Print("bidi 0.3 -> 4.7 KB, 16 under way", bare.Bidirectional(300, 4'700, 16, seconds));
  EndServer(child);
  return 0;
}

}  // namespace
}  // namespace voxelpipe::bench

int main(int argc, char** argv) {
  return voxelpipe::bench::Main(argc, argv);
}
