// What the writers of all formats take of a job: memory, which they charge before they allocate it, and time after its
// end.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <chrono>
#include <cstring>

#include "base/limit_error.h"
#include "encode/encode.h"
#include "encode/format_registry.h"
#include "grid/page_pool.h"
#include "support/counting_memory.h"
#include "unit/encode/counting_polls.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using namespace testing;

constexpr uint64_t kOfAllFiles = 12 * kMiB;  // buffers of a fixed size, and what threads begin with

std::string NameOf(const ::testing::TestParamInfo<std::string>& tested) {
  std::string name = tested.param;
  std::erase(name, '.');
  return name;
}

// A brick of 8x8x8 voxels by its index, and a word for each z.
using Brick = std::pair<std::array<uint64_t, 3>, std::array<uint64_t, 8>>;

// Bricks in the order of a sparse result, with a colour for each voxel.
VoxelizeResult SparseOf(std::array<int64_t, 3> dims, const std::vector<Brick>& bricks) {
  VoxelizeRequest request;
  request.result = ResultKind::kSparse;
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].components = 3;
  request.targets[0].blend = Blend::kReplace;
  request.targets[0].shader = {"base_color", {}};
  GridSpec grid;
  grid.dims = dims;
  uint64_t voxels = 0;
  for (const auto& [place, words] : bricks) {
    for (const uint64_t word : words) voxels += uint64_t(std::popcount(word));
  }
  VoxelizeResult result = AllocateResult(MakeResultHeader(request, grid, bricks.size(), voxels, 0)).value();
  const uint64_t across = uint64_t(dims[0] + 7) / 8, rows = uint64_t(dims[1] + 7) / 8;
  for (size_t b = 0; b < bricks.size(); ++b) {
    const auto& [place, words] = bricks[b];
    const uint64_t id = place[0] + across * (place[1] + rows * place[2]);
    std::memcpy(result.bricks.data() + 8 * b, &id, sizeof id);
    std::memcpy(result.masks.data() + 64 * b, words.data(), 64);
  }
  for (uint64_t n = 0; n < 3 * voxels; ++n) {
    const float value = float(n * 37 % 256) / 255;
    std::memcpy(result.targets[0].data() + 4 * n, &value, sizeof value);
  }
  return result;
}

VoxelizeResult OneVoxelOf2048Cubed() {
  return SparseOf({2048, 2048, 2048}, {{{131, 17, 201}, {0, 0, 1 << 9}}});
}

// A voxel in each of 22^3 bricks.
VoxelizeResult ScatteredIn2048Cubed() {
  std::vector<Brick> bricks;
  for (uint64_t z = 100; z < 122; ++z) {
    for (uint64_t y = 200; y < 222; ++y) {
      for (uint64_t x = 3; x < 25; ++x)
        bricks.push_back({{x, y, z}, {0, 0, 0, uint64_t{1} << ((x * 7 + y * 3 + z) % 64)}});
    }
  }
  return SparseOf({2048, 2048, 2048}, bricks);
}

// The surface of a solid, and much of it empty.
VoxelizeResult DenseBody() {
  constexpr int64_t kSide = 112;
  VoxelizeResult result = EmptyResult({kSide, kSide, kSide});
  AddFloats(
      result, 3,
      [](int64_t i, int64_t j, int64_t k, int c) {
        const int64_t d = (i - 50) * (i - 50) + (j - 54) * (j - 54) + (k - 60) * (k - 60);
        return d < 2200 ? float((i * 5 + j * 3 + k * 7 + c * 40) % 240 + 10) / 255 : 0.0f;
      },
      "base_color");
  return result;
}

// The same body in labels.
VoxelizeResult DenseLabels() {
  constexpr int64_t kSide = 112;
  VoxelizeResult result = EmptyResult({kSide, kSide, kSide});
  AddLabels<uint16_t>(result, [](int64_t i, int64_t j, int64_t k) {
    const int64_t d = (i - 50) * (i - 50) + (j - 54) * (j - 54) + (k - 60) * (k - 60);
    return d < 2200 ? uint32_t(1 + (i * 5 + j * 3 + k * 7) % 240) : 0u;
  });
  return result;
}

// As many parts as a result may have, more than voxels.
VoxelizeResult ManyParts() {
  VoxelizeResult result = EmptyResult({16, 16, 16});
  AddLabels<uint16_t>(result, [](int64_t i, int64_t j, int64_t k) { return uint32_t(i + 16 * j + 256 * k); });
  std::vector<SamplePart> parts;
  for (uint32_t n = 1; n <= 65'535; ++n) parts.emplace_back(n, "part number " + std::to_string(n));
  AddParts(result, parts);
  return result;
}

class EncoderWork : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    const OutputFormat& format = *FindFormat("." + GetParam());
    for (VoxelizeResult (*make)() :
         {&OneVoxelOf2048Cubed, &ScatteredIn2048Cubed, &DenseBody, &DenseLabels, &ManyParts}) {
      VoxelizeResult result = make();
      if (format.Holds(result.kind) && CheckHolds(format.extension, result.kind, result.specs).ok())
        results_.push_back(std::move(result));
    }
    if (FindFormat("." + GetParam())->picture()) results_.resize(1);  // a second each
  }

  absl::Status Write(const VoxelizeResult& result, MemoryBudget& memory) {
    JobContext job;
    job.set_memory(&memory);
    return WriteResult(result, directory_ / ("a." + GetParam()), &job);
  }

  TemporaryDirectory directory_;
  std::vector<VoxelizeResult> results_;
};

TEST_P(EncoderWork, WhatItAllocatesIsChargedAndLittleMore) {
  MemoryBudget ample(uint64_t{8} << 30);
  for (const VoxelizeResult& result : results_) {  // threads and tables of the libraries begin
    ASSERT_TRUE(Write(result, ample).ok());
  }
  for (const VoxelizeResult& result : results_) {
    MemoryBudget memory(uint64_t{8} << 30);
    ReleaseIdlePages();
    const uint64_t before = AllocatedBytes();
    ResetAllocatedPeak();
    const absl::Status status = Write(result, memory);
    EXPECT_TRUE(status.ok()) << status;
    EXPECT_EQ(memory.used_bytes(), 0u);
    if (!CountsMemory()) continue;
    const uint64_t measured = AllocatedPeak() - before, charged = memory.peak_bytes();
    EXPECT_LE(measured, charged + charged / 4 + kOfAllFiles);
    EXPECT_LE(charged, measured + measured / 2 + kOfAllFiles);
    std::cout << "charged " << (charged >> 10) << " KiB, measured " << (measured >> 10) << " KiB" << std::endl;
  }
}

TEST_P(EncoderWork, ALittleResultOfALargeGridTakesLittleMemory) {
  if (results_[0].kind != ResultKind::kSparse) return;  // formats that hold dense results alone
  MemoryBudget memory(48 * kMiB);
  const absl::Status status = Write(results_[0], memory);
  EXPECT_TRUE(status.ok()) << status;
}

TEST_P(EncoderWork, WithoutTheMemoryItIsRefusedAndLeavesNoFile) {
  for (const VoxelizeResult& result : results_) {
    MemoryBudget ample(uint64_t{8} << 30);
    ASSERT_TRUE(Write(result, ample).ok());
    std::filesystem::remove_all(directory_ / ("a." + GetParam()));
    if (ample.peak_bytes() == 0) continue;  // .raw has no buffers
    const size_t files = directory_.FileCount();
    for (const uint64_t part : {2, 3, 10, 1000}) {
      MemoryBudget little(ample.peak_bytes() - ample.peak_bytes() / part);
      const absl::Status refused = Write(result, little);
      EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted) << refused;
      EXPECT_TRUE(LimitErrorOf(refused).has_value()) << refused;
      EXPECT_EQ(little.used_bytes(), 0u);
      EXPECT_EQ(directory_.FileCount(), files);
    }
  }
}

TEST_P(EncoderWork, EndsWithItsJobAtAnyMomentAndLeavesNoFile) {
  constexpr uint64_t kOtherLooks = 2;                                              // at the clock, by the pool of pages
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);  // the same looks each time
  for (const VoxelizeResult& result : results_) {
    const auto write = [&](uint64_t look) {
      JobContext job;
      job.set_deadline(JobContext::Clock::now() + std::chrono::hours(24));
      CountLooks(&job, look);
      absl::Status status = WriteResult(result, directory_ / ("a." + GetParam()), &job);
      const uint64_t looks = Looks();
      CountLooks(nullptr, 0);
      return std::pair(std::move(status), looks);
    };
    const auto [written, looks] = write(~uint64_t{0});
    ASSERT_TRUE(written.ok()) << written;
    std::filesystem::remove_all(directory_.path());
    std::filesystem::create_directory(directory_.path());
    for (uint64_t moment = 0; moment < 10; ++moment) {
      const uint64_t look = std::max<uint64_t>(1, moment * looks / 10);
      if (look + kOtherLooks >= looks) continue;
      const auto [ended, looked] = write(look);
      EXPECT_EQ(ended.code(), absl::StatusCode::kCancelled) << "look " << look << " of " << looks << ": " << ended;
      EXPECT_EQ(directory_.FileCount(), 0u);
      EXPECT_LE(looked, look + kOtherLooks) << "a cancelled job does not read the clock";
    }
  }
}

std::vector<std::string> Formats() {
  std::vector<std::string> names;
  for (const OutputFormat& format : OutputFormats()) names.emplace_back(format.name);
  return names;
}

INSTANTIATE_TEST_SUITE_P(Formats, EncoderWork, ::testing::ValuesIn(Formats()), NameOf);

}  // namespace
}  // namespace voxelpipe
