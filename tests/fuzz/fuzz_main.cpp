// Drives the fuzz target without libFuzzer: random bytes, or files whose cases are to be repeated.
//   voxelize_fuzz [--seconds N | --cases N] [--seed S] [--save FILE]      voxelize_fuzz FILE...
// The bytes of the case at work are in --save's FILE, so that a case that ends the process can be repeated.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace {

struct Options {
  double seconds = 0;
  long long cases = 1000;
  unsigned long long seed = 1;
  std::string save;
  std::vector<std::string> files;
};

Options Parse(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    const char* const value = i + 1 < argc ? argv[i + 1] : "";
    if (name == "--seconds") {
      options.seconds = std::atof(value);
      ++i;
    } else if (name == "--cases") {
      options.cases = std::atoll(value);
      ++i;
    } else if (name == "--seed") {
      options.seed = std::strtoull(value, nullptr, 10);
      ++i;
    } else if (name == "--save") {
      options.save = value;
      ++i;
    } else {
      options.files.push_back(name);
    }
  }
  return options;
}

int Repeat(const std::vector<std::string>& files) {
  for (const std::string& file : files) {
    std::ifstream in(file, std::ios::binary);
    if (!in) {
      std::fprintf(stderr, "%s cannot be read\n", file.c_str());
      return 1;
    }
    const std::vector<char> bytes{std::istreambuf_iterator<char>(in), {}};
    LLVMFuzzerTestOneInput(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size());
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const Options options = Parse(argc, argv);
  if (!options.files.empty()) return Repeat(options.files);
  const auto start = std::chrono::steady_clock::now();
  const auto elapsed = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); };
  long long done = 0;
  for (; options.seconds > 0 ? elapsed() < options.seconds : done < options.cases; ++done) {
    std::mt19937_64 random(options.seed * 1000003 + static_cast<unsigned long long>(done));
    std::vector<uint8_t> bytes(64 + random() % 1024);
    for (uint8_t& b : bytes) b = static_cast<uint8_t>(random());
    if (!options.save.empty()) {
      std::ofstream(options.save, std::ios::binary)
          .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    }
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  }
  std::printf("%lld cases in %.1f s, nothing wrong\n", done, elapsed());
  return 0;
}
