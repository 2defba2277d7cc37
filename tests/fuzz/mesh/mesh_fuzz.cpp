// Sends spoilt meshes and requests to one server process and watches what they cost; and runs them here as well, where
// both must say the same. What is looked for: the server's end, an answer that takes more than 2 s, memory that grows
// by more than 1 GiB, and answers that differ.
//   mesh_fuzz [--server voxelpiped] [--seconds N | --cases N] [--seed S] [--first N] [--jobs N] [--differential K]
//             [--save DIR]
// --differential K runs every K-th case here too (0: none). A case is its seed and number: --first N --cases 1 runs it
// again. --save keeps the file of each case that was found at fault in DIR, and of the one that runs here.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "client.h"
#include "engine/engine.h"
#include "engine/hash.h"
#include "fuzz/mesh/mutate.h"
#include "fuzz/mesh/server_watch.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe::fuzz {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kMaxSeconds = 2;
constexpr uint64_t kMaxBytes = uint64_t{1} << 30;
constexpr std::chrono::seconds kDeadline{20};  // of a call; a hang is seen long before
// Of a call: what is larger takes its time with good reason.
constexpr char kMaxResult[] = "8MiB", kMaxWorking[] = "256MiB";

struct Options {
  std::string server = "voxelpiped", save;
  double seconds = 0;
  uint64_t cases = 2000, seed = 1, first = 0, differential = 10;
  size_t jobs = std::max(1u, std::thread::hardware_concurrency());
};

double Since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

// What one side says of a case.
struct Answer {
  absl::Status status = absl::OkStatus();
  std::string hash;  // of a result
  double seconds = 0;
};

Answer AskServer(Client& client, const Case& asked) {
  JobContext job;
  job.set_deadline(Clock::now() + kDeadline);
  cli::HashingSink sink(nullptr);
  const Clock::time_point begin = Clock::now();
  Answer answer;
  answer.status = client.VoxelizeTo(asked.mesh, MeshFormat::kAuto, asked.request, job, sink).status();
  answer.seconds = Since(begin);
  if (answer.status.ok()) answer.hash = sink.Digest();
  return answer;
}

Answer AskHere(cli::Engine& engine, const Case& asked) {
  JobContext job;
  job.set_deadline(Clock::now() + kDeadline);
  cli::HashingSink sink(nullptr);
  const Clock::time_point begin = Clock::now();
  Answer answer;
  answer.status = ValidateRequest(asked.request);  // as the CLI does, before it reads a mesh
  if (!answer.status.ok()) return answer;
  cli::MeshInputs meshes;
  cli::MeshInput& mesh = meshes.files.emplace_back();
  mesh.bytes.assign(asked.mesh.begin(), asked.mesh.end());
  answer.status = engine.Run(std::move(meshes), asked.request, 1, job, sink).status();
  answer.seconds = Since(begin);
  if (answer.status.ok()) answer.hash = sink.Digest();
  return answer;
}

// True if the limits of a server and of this process may differ in it, or the time.
bool DependsOnTheProcess(const absl::Status& status) {
  return absl::IsResourceExhausted(status) || absl::IsDeadlineExceeded(status) || absl::IsCancelled(status);
}

std::string Shown(const Answer& answer) {
  return answer.status.ok()
             ? "bytes " + answer.hash.substr(0, 16)
             : absl::StrCat(absl::StatusCodeToString(answer.status.code()), ": ", ErrorText(answer.status));
}

class Fuzzer {
 public:
  explicit Fuzzer(Options options) : options_(std::move(options)), next_(options_.first) {}

  int Run() {
    if (!options_.save.empty()) std::filesystem::create_directories(options_.save);
    if (!StartServer()) return 2;
    std::vector<std::thread> threads;
    for (size_t i = 0; i < options_.jobs; ++i) threads.emplace_back([this] { Work(); });
    std::thread memory([this] { WatchMemory(); });
    for (std::thread& thread : threads) thread.join();
    done_ = true;
    memory.join();
    const double seconds = Since(begin_);
    Confirm();
    std::printf(
        "%llu cases in %.1f s, %.0f a second; %llu answered with a result, %llu with an error, %llu compared; "
        "peak memory %llu MiB, longest answer %.2f s; %d at fault\n",
        static_cast<unsigned long long>(cases_), seconds, double(cases_) / seconds,
        static_cast<unsigned long long>(results_), static_cast<unsigned long long>(cases_ - results_),
        static_cast<unsigned long long>(compared_), static_cast<unsigned long long>(peak_ >> 20), longest_, faults_);
    return faults_ == 0 ? 0 : 1;
  }

 private:
  bool StartServer() {
    absl::StatusOr<std::unique_ptr<ServerWatch>> server = ServerWatch::Start(
        options_.server, {"--log-level", "error", "--max-result-bytes", kMaxResult, "--max-working-bytes", kMaxWorking},
        InFolder("server.log"));
    if (!server.ok()) {
      std::fprintf(stderr, "mesh_fuzz: %s\n", std::string(server.status().message()).c_str());
      return false;
    }
    server_ = *std::move(server);
    before_ = server_->ResidentBytes();
    return true;
  }

  std::string InFolder(const std::string& name) const {
    return options_.save.empty() ? (name == "server.log" ? "/dev/null" : "") : options_.save + "/" + name;
  }

  // Tells of a case at fault, and keeps its file. Under the lock.
  void Fault(uint64_t number, const Case& made, const std::string& what) {
    ++faults_;
    std::string file = InFolder(absl::StrCat("case-", options_.seed, "-", number));
    if (!file.empty()) Keep(made, file);
    std::printf("--seed %llu --first %llu --cases 1 (%s, %zu bytes): %s\n",
                static_cast<unsigned long long>(options_.seed), static_cast<unsigned long long>(number),
                made.seed.c_str(), made.mesh.size(), what.c_str());
    std::fflush(stdout);
  }

  static void Keep(const Case& made, const std::string& file) {
    std::ofstream(file, std::ios::binary)
        .write(reinterpret_cast<const char*>(made.mesh.data()), std::streamsize(made.mesh.size()));
  }

  void Work() {
    const std::unique_ptr<cli::Engine> engine = cli::MakeLocalEngine();
    std::unique_ptr<Client> client;
    for (;;) {
      const uint64_t number = next_++;
      if (options_.seconds > 0 ? Since(begin_) >= options_.seconds : number >= options_.first + options_.cases) return;
      if (ServerIsGone()) return;
      const Case made = MakeCase(options_.seed, number);
      if (client == nullptr) {
        absl::StatusOr<std::unique_ptr<Client>> connected = Client::Connect(server_->address());
        if (!connected.ok()) continue;
        client = *std::move(connected);
      }
      {
        const std::lock_guard lock(mutex_);
        running_.push_back(number);
      }
      const Answer served = AskServer(*client, made);
      {
        const std::lock_guard lock(mutex_);
        running_.erase(std::find(running_.begin(), running_.end(), number));
        ++cases_;
        results_ += served.status.ok() ? 1 : 0;
        longest_ = std::max(longest_, served.seconds);
        if (served.seconds > kMaxSeconds || absl::IsUnavailable(served.status)) suspects_.push_back(number);
      }
      if (absl::IsUnavailable(served.status)) {
        client = nullptr;
        continue;  // ServerIsGone tells whether it ended
      }
      if (options_.differential > 0 && number % options_.differential == 0) Compare(*engine, number, made, served);
    }
  }

  void Compare(cli::Engine& engine, uint64_t number, const Case& made, const Answer& served) {
    if (DependsOnTheProcess(served.status)) return;
    if (!options_.save.empty())
      Keep(made, InFolder("here-" + absl::StrCat(std::hash<std::thread::id>()(std::this_thread::get_id()))));
    const Answer here = AskHere(engine, made);
    const std::lock_guard lock(mutex_);
    ++compared_;
    if (DependsOnTheProcess(here.status)) return;
    if (Shown(here) == Shown(served)) return;
    Fault(number, made, absl::StrCat("differs: here ", Shown(here), "; served ", Shown(served)));
  }

  // Tells once which cases ran when the server ended.
  bool ServerIsGone() {
    const std::lock_guard lock(mutex_);
    if (gone_) return true;
    const std::string how = server_->Ended();
    if (how.empty()) return false;
    gone_ = true;
    std::printf("the server ended: %s\n", how.c_str());
    ++faults_;
    for (const uint64_t number : running_) Fault(number, MakeCase(options_.seed, number), "ran when the server ended");
    return true;
  }

  void WatchMemory() {
    while (!done_) {
      const uint64_t bytes = server_->ResidentBytes();
      {
        const std::lock_guard lock(mutex_);
        peak_ = std::max(peak_, bytes);
        if (bytes > before_ + kMaxBytes && !over_) {
          over_ = true;
          suspects_.insert(suspects_.end(), running_.begin(), running_.end());
        }
        if (bytes < before_ + kMaxBytes) over_ = false;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }

  // On a busy machine an answer may be late for no fault of its own, and cases that run together add up: each that is
  // suspected runs alone, on a fresh server.
  void Confirm() {
    constexpr size_t kMaxSuspects = 50;
    std::sort(suspects_.begin(), suspects_.end());
    suspects_.erase(std::unique(suspects_.begin(), suspects_.end()), suspects_.end());
    if (suspects_.size() > kMaxSuspects) {
      std::printf("%zu cases are suspected, the first %zu are looked at\n", suspects_.size(), kMaxSuspects);
      suspects_.resize(kMaxSuspects);
    }
    for (const uint64_t number : suspects_) {
      server_ = nullptr;
      if (!StartServer()) return;
      const Case made = MakeCase(options_.seed, number);
      absl::StatusOr<std::unique_ptr<Client>> client = Client::Connect(server_->address());
      if (!client.ok()) continue;
      std::atomic<bool> over = false;
      uint64_t most = 0;
      std::thread watch([&] {
        while (!over) {
          most = std::max(most, server_->ResidentBytes());
          std::this_thread::sleep_for(std::chrono::milliseconds(2));
        }
      });
      const Answer answer = AskServer(**client, made);
      over = true;
      watch.join();
      const std::lock_guard lock(mutex_);
      if (const std::string how = server_->Ended(); !how.empty()) Fault(number, made, "the server ended: " + how);
      if (answer.seconds > kMaxSeconds) {
        Fault(number, made, absl::StrCat("took ", answer.seconds, " s: ", Shown(answer)));
      }
      if (most > before_ + kMaxBytes) {
        Fault(number, made, absl::StrCat("memory grew by ", (most - before_) >> 20, " MiB: ", Shown(answer)));
      }
    }
  }

  const Options options_;
  const Clock::time_point begin_ = Clock::now();
  std::unique_ptr<ServerWatch> server_;
  std::atomic<uint64_t> next_;
  std::atomic<bool> done_ = false;
  std::mutex mutex_;  // of all that follows
  std::vector<uint64_t> running_, suspects_;
  uint64_t cases_ = 0, results_ = 0, compared_ = 0, before_ = 0, peak_ = 0;
  double longest_ = 0;
  int faults_ = 0;
  bool gone_ = false, over_ = false;
};

bool Parse(int argc, char** argv, Options& options) {
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = argv[i];
    const char* const value = argv[i + 1];
    const auto number = [&] { return std::strtoull(value, nullptr, 10); };
    if (name == "--server")
      options.server = value;
    else if (name == "--save")
      options.save = value;
    else if (name == "--seconds")
      options.seconds = std::atof(value);
    else if (name == "--cases")
      options.cases = number();
    else if (name == "--seed")
      options.seed = number();
    else if (name == "--first")
      options.first = number();
    else if (name == "--jobs")
      options.jobs = std::max<size_t>(1, number());
    else if (name == "--differential")
      options.differential = number();
    else
      return false;
  }
  return argc % 2 == 1;
}

}  // namespace
}  // namespace voxelpipe::fuzz

int main(int argc, char** argv) {
  voxelpipe::fuzz::Options options;
  if (!voxelpipe::fuzz::Parse(argc, argv, options)) {
    std::fprintf(stderr,
                 "usage: mesh_fuzz [--server voxelpiped] [--seconds N | --cases N] [--seed S] [--first N] [--jobs N] "
                 "[--differential K] [--save DIR]\n");
    return 2;
  }
  setenv("GRPC_VERBOSITY", "NONE", 0);
  return voxelpipe::fuzz::Fuzzer(std::move(options)).Run();
}
