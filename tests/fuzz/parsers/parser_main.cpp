// Runs the parsers over spoilt seeds without libFuzzer.
//   parser_fuzz [--seconds N | --cases N] [--seed S] [--save FILE] [PARSER [FILE...]]
// All parsers take turns unless one is named; with files it gets those. The bytes at work are in --save's FILE.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "fuzz/mesh/mutate.h"
#include "fuzz/parsers/parsers.h"

namespace voxelpipe::fuzz {
namespace {

int Repeat(const Parser& parser, const std::vector<std::string>& files) {
  for (const std::string& file : files) {
    std::ifstream in(file, std::ios::binary);
    if (!in) {
      std::fprintf(stderr, "%s cannot be read\n", file.c_str());
      return 1;
    }
    const std::vector<char> bytes{std::istreambuf_iterator<char>(in), {}};
    parser.run({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()});
  }
  return 0;
}

int Main(int argc, char** argv) {
  double seconds = 0, longest = 0;
  uint64_t cases = 4000, seed = 1;
  std::string save, longest_of;
  std::vector<std::string> names;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    const char* const value = i + 1 < argc ? argv[i + 1] : "";
    if (name == "--seconds")
      seconds = std::atof(value);
    else if (name == "--cases")
      cases = std::strtoull(value, nullptr, 10);
    else if (name == "--seed")
      seed = std::strtoull(value, nullptr, 10);
    else if (name == "--save")
      save = value;
    else {
      names.push_back(name);
      continue;
    }
    ++i;
  }
  std::vector<Parser> parsers(Parsers().begin(), Parsers().end());
  if (!names.empty()) {
    const Parser* const parser = FindParser(names[0]);
    if (parser == nullptr) {
      std::fprintf(stderr, "no parser '%s'\n", names[0].c_str());
      return 2;
    }
    if (names.size() > 1) return Repeat(*parser, {names.begin() + 1, names.end()});
    parsers = {*parser};
  }
  std::vector<std::vector<std::vector<uint8_t>>> seeds;
  for (const Parser& parser : parsers) seeds.push_back(parser.seeds());

  using Clock = std::chrono::steady_clock;
  const auto since = [](Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
  };
  const Clock::time_point begin = Clock::now();
  uint64_t done = 0;
  for (; seconds > 0 ? since(begin) < seconds : done < cases; ++done) {
    Random random(seed * 1000003 + done);
    const size_t at = done % parsers.size();
    std::vector<uint8_t> bytes = seeds[at][random() % seeds[at].size()];
    SpoilBytes(bytes, random);
    if (!save.empty()) {
      std::ofstream(save, std::ios::binary)
          .write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
    }
    const Clock::time_point one = Clock::now();
    parsers[at].run(bytes);
    if (const double took = since(one); took > longest) {
      longest = took;
      longest_of = parsers[at].name;
    }
  }
  constexpr double kMaxSeconds = 2;
  std::printf("%llu cases in %.1f s, longest %.3f s (%s)\n", static_cast<unsigned long long>(done), since(begin),
              longest, longest_of.c_str());
  return longest > kMaxSeconds ? 1 : 0;
}

}  // namespace
}  // namespace voxelpipe::fuzz

int main(int argc, char** argv) {
  return voxelpipe::fuzz::Main(argc, argv);
}
