// Small readers of the files of encoders, for their tests.
#pragma once

#include <gtest/gtest.h>
#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "unit/encode/sample_results.h"

namespace voxelpipe::testing {

// A whole zlib or gzip stream; fails on a wrong checksum or bytes after it.
inline std::string Inflated(std::span<const uint8_t> compressed) {
  z_stream stream{};
  EXPECT_EQ(inflateInit2(&stream, 15 + 32), Z_OK);  // either wrapper
  stream.next_in = const_cast<uint8_t*>(compressed.data());
  stream.avail_in = uInt(compressed.size());
  std::string text;
  int code = Z_OK;
  while (code == Z_OK) {
    char buffer[4096];
    stream.next_out = reinterpret_cast<uint8_t*>(buffer);
    stream.avail_out = sizeof buffer;
    code = inflate(&stream, Z_NO_FLUSH);
    text.append(buffer, sizeof buffer - stream.avail_out);
  }
  EXPECT_EQ(code, Z_STREAM_END);
  EXPECT_EQ(stream.avail_in, 0u);
  inflateEnd(&stream);
  return text;
}

template <typename T>
T NumberAt(std::string_view bytes, size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

// The bytes of an array of a .vti of cells or fields: by its table of compressed blocks, or as a stream has them.
inline std::string VtiArray(const std::string& file, const std::string& name) {
  const size_t named = file.find("Name=\"" + name + "\"");
  const uint64_t offset = std::stoull(file.substr(file.find("offset=\"", named) + 8, 20));
  size_t at = file.find('_', file.find("<AppendedData")) + 1 + offset;
  const auto next = [&] {
    at += 8;
    return NumberAt<uint64_t>(file, at - 8);
  };
  if (file.find("compressor=") == std::string::npos) {
    const uint64_t bytes = next();
    return file.substr(at, bytes);
  }
  const uint64_t blocks = next(), block_bytes = next(), last_bytes = next();
  std::vector<uint64_t> sizes(blocks);
  for (uint64_t& size : sizes) size = next();
  std::string bytes;
  for (const uint64_t size : sizes) {
    bytes += Inflated({reinterpret_cast<const uint8_t*>(&file[at]), size});
    at += size;
  }
  EXPECT_EQ(bytes.size(), (blocks - (last_bytes > 0)) * block_bytes + last_bytes);
  return bytes;
}

inline std::string WrittenText(const std::string& path) {
  const std::vector<uint8_t> bytes = ReadFile(path);
  return {bytes.begin(), bytes.end()};
}

}  // namespace voxelpipe::testing
