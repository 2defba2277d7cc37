// What holds for the files that a mesh names, in every format that names some.
#pragma once

#include <filesystem>
#include <string>

#include "base/job_context.h"
#include "base/memory_budget.h"
#include "gtest/gtest.h"
#include "load/pack.h"

namespace voxelpipe::testing {

// In: the text of a mesh, and its folder with the files that it names, more than 512 KiB and less than 8 MiB of them.
// Expects that packing charges them to the job's memory, returns all of it, and ends with the job.
inline void ExpectPackingIsChargedAndPolled(const std::string& text, const std::filesystem::path& folder) {
  const auto pack = [&](JobContext& job) {
    return PackMesh(job, FileBytes(text.begin(), text.end()), folder).status();
  };
  MemoryBudget little(512 << 10), enough(16 << 20);
  JobContext job;
  job.set_memory(&little);
  EXPECT_EQ(pack(job).code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(little.used_bytes(), 0u);
  job.set_memory(&enough);
  EXPECT_TRUE(pack(job).ok());
  EXPECT_GT(enough.peak_bytes(), uint64_t{1} << 20);
  EXPECT_EQ(enough.used_bytes(), 0u);
  job.Cancel();
  EXPECT_EQ(pack(job).code(), absl::StatusCode::kCancelled);
}

}  // namespace voxelpipe::testing
