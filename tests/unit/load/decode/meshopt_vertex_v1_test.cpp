// Version 1 of the vertex codec, against an encoder that is written here from the specification, apart from the
// decoder.
#include "load/decode/meshopt_vertex_v1.h"

#include <algorithm>
#include <bit>
#include <random>

#include "gtest/gtest.h"
#include "load/decode/meshopt.h"

namespace voxelpipe {
namespace {

using Bytes = std::vector<uint8_t>;

// How a channel (4 bytes of the stride) is kept.
struct Channel {
  int mode = 0;      // 0: bytes, 1: shorts, 2: words by XOR
  int rotation = 0;  // of mode 2, to the left
};

uint32_t Read(const Bytes& bytes, size_t at, size_t size) {
  uint32_t value = 0;
  for (size_t b = 0; b < size; ++b) value |= uint32_t(bytes[at + b]) << (8 * b);
  return value;
}

uint32_t Zigzag(uint32_t delta, int bits) {
  const bool negative = ((delta >> (bits - 1)) & 1) != 0;
  const uint32_t mask = bits == 32 ? ~0u : (1u << bits) - 1;
  return ((delta << 1) ^ (negative ? mask : 0)) & mask;
}

// The four bytes of each vertex's difference to the one before.
std::vector<Bytes> Lanes(const Bytes& vertices, size_t stride, size_t channel, const Channel& how, Bytes last,
                         size_t begin, size_t end) {
  std::vector<Bytes> lanes(4);
  for (size_t v = begin; v < end; ++v) {
    const size_t size = how.mode == 0 ? 1 : how.mode == 1 ? 2 : 4;
    for (size_t first = 0; first < 4; first += size) {
      const uint32_t value = Read(vertices, v * stride + 4 * channel + first, size);
      const uint32_t before = Read(last, first, size);
      const uint32_t delta =
          how.mode == 2 ? std::rotl(value ^ before, how.rotation) : Zigzag(value - before, int(8 * size));
      for (size_t b = 0; b < size; ++b) lanes[first + b].push_back(uint8_t(delta >> (8 * b)));
    }
    for (size_t b = 0; b < 4; ++b) last[b] = vertices[v * stride + 4 * channel + b];
  }
  return lanes;
}

// A group of 16 bytes in `bits` bits each, those too large behind it.
void PutGroup(const uint8_t* values, int bits, Bytes& out) {
  if (bits == 0) return;
  if (bits == 8) return void(out.insert(out.end(), values, values + 16));
  const int escape = (1 << bits) - 1;
  Bytes packed(size_t(16 * bits / 8), 0), behind;
  for (int i = 0; i < 16; ++i) {
    const int value = std::min<int>(values[i], escape);
    if (value == escape) behind.push_back(values[i]);
    const int per_byte = 8 / bits, place = i % per_byte;
    const int shift = bits == 1 ? place : (per_byte - 1 - place) * bits;
    packed[size_t(i / per_byte)] = uint8_t(packed[size_t(i / per_byte)] | value << shift);
  }
  out.insert(out.end(), packed.begin(), packed.end());
  out.insert(out.end(), behind.begin(), behind.end());
}

// One lane by `control`, group widths in turn.
void PutLane(Bytes lane, int control, Bytes& out) {
  if (control == 2) return;
  if (control == 3) return void(out.insert(out.end(), lane.begin(), lane.end()));
  constexpr int kBits[2][4] = {{0, 1, 2, 4}, {1, 2, 4, 8}};
  lane.resize((lane.size() + 15) / 16 * 16);
  const size_t groups = lane.size() / 16;
  Bytes widths((groups + 3) / 4, 0), data;
  for (size_t g = 0; g < groups; ++g) {
    const bool zeros =
        std::all_of(lane.begin() + long(16 * g), lane.begin() + long(16 * g + 16), [](uint8_t v) { return v == 0; });
    int width = int(g % 4);
    if (control == 0 && width == 0 && !zeros) width = 1;  // no bits hold zeros alone
    widths[g / 4] = uint8_t(widths[g / 4] | width << (g % 4 * 2));
    PutGroup(lane.data() + 16 * g, kBits[control][width], data);
  }
  out.insert(out.end(), widths.begin(), widths.end());
  out.insert(out.end(), data.begin(), data.end());
}

Bytes Encode(const Bytes& vertices, size_t stride, const std::vector<Channel>& channels) {
  const size_t count = vertices.size() / stride;
  const size_t block = std::min<size_t>(256, 8192 / stride / 16 * 16);
  Bytes out = {0xa1}, last(stride);
  if (count > 0) last.assign(vertices.begin(), vertices.begin() + long(stride));
  const Bytes first = last;
  for (size_t begin = 0; begin < count; begin += block) {
    const size_t end = std::min(count, begin + block);
    Bytes controls, data;
    for (size_t c = 0; c < stride / 4; ++c) {
      const Bytes before(last.begin() + long(4 * c), last.begin() + long(4 * c + 4));
      const std::vector<Bytes> lanes = Lanes(vertices, stride, c, channels[c], before, begin, end);
      int control = 0;
      for (int b = 0; b < 4; ++b) {
        const bool zeros =
            std::all_of(lanes[size_t(b)].begin(), lanes[size_t(b)].end(), [](uint8_t v) { return v == 0; });
        const int of_lane = zeros ? 2 : int((begin / block + c + size_t(b)) % 4 == 2 ? 1 : (c + size_t(b)) % 4);
        control |= (of_lane == 2 && !zeros ? 3 : of_lane) << (2 * b);
        PutLane(lanes[size_t(b)], (control >> (2 * b)) & 3, data);
      }
      controls.push_back(uint8_t(control));
    }
    out.insert(out.end(), controls.begin(), controls.end());
    out.insert(out.end(), data.begin(), data.end());
    last.assign(vertices.begin() + long((end - 1) * stride), vertices.begin() + long(end * stride));
  }
  const size_t tail = stride + stride / 4;
  if (tail < 24) out.insert(out.end(), 24 - tail, 0);
  out.insert(out.end(), first.begin(), first.end());
  for (const Channel& channel : channels) {
    out.push_back(uint8_t(channel.mode | (channel.mode == 2 ? channel.rotation << 4 : 0)));
  }
  return out;
}

// Random walks of words, of which some bytes never change.
Bytes Vertices(size_t count, size_t stride, uint32_t seed) {
  std::mt19937 random(seed);
  Bytes out(count * stride);
  std::vector<uint32_t> words(stride / 4);
  for (size_t v = 0; v < count; ++v) {
    for (size_t c = 0; c < words.size(); ++c) {
      const uint32_t span = c % 3 == 0 ? 0xffffffff : c % 3 == 1 ? 0x0000ff07 : 0x00000003;
      words[c] += random() & span;
      for (size_t b = 0; b < 4; ++b) out[v * stride + 4 * c + b] = uint8_t(words[c] >> (8 * b));
    }
  }
  return out;
}

std::vector<Channel> Channels(size_t stride, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<Channel> channels;
  for (size_t c = 0; c < stride / 4; ++c) channels.push_back({int(random() % 3), int(random() % 16)});
  return channels;
}

TEST(MeshoptVertexV1, GivesBackWhatWasEncoded) {
  for (const size_t stride : {size_t{4}, size_t{12}, size_t{16}, size_t{64}, size_t{256}}) {
    for (const size_t count : {1u, 15u, 16u, 17u, 255u, 256u, 257u, 700u}) {
      for (uint32_t seed = 0; seed < 4; ++seed) {
        const Bytes vertices = Vertices(count, stride, seed);
        const Bytes stream = Encode(vertices, stride, Channels(stride, seed));
        Bytes out(vertices.size());
        ASSERT_TRUE(DecodeMeshoptVertexV1(stream, stride, out)) << stride << " x " << count << ", seed " << seed;
        ASSERT_EQ(out, vertices) << stride << " x " << count << ", seed " << seed;
      }
    }
  }
}

TEST(MeshoptVertexV1, IsPartOfKhrAlone) {
  const Bytes vertices = Vertices(40, 12, 1);
  MeshoptView view;
  view.count = 40;
  view.byte_stride = 12;
  view.mode = "ATTRIBUTES";
  const Bytes stream = Encode(vertices, 12, Channels(12, 1));
  EXPECT_FALSE(DecodeMeshopt(stream, view).ok());
  view.khr = true;
  const auto decoded = DecodeMeshopt(stream, view);
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(*decoded, vertices);
}

TEST(MeshoptVertexV1, ConstantVerticesTakeHardlyAByte) {
  Bytes vertices(size_t{100'000} * 8, 7);
  const Bytes stream = Encode(vertices, 8, Channels(8, 0));
  EXPECT_LT(stream.size(), 1000u);
  MeshoptView view;
  view.count = 100'000;
  view.byte_stride = 8;
  view.mode = "ATTRIBUTES";
  view.khr = true;
  const auto decoded = DecodeMeshopt(stream, view);
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(*decoded, vertices);
}

TEST(MeshoptVertexV1, CutAndChangedStreamsAreRefusedOrGiveAsMuch) {
  const Bytes vertices = Vertices(300, 16, 3);
  const Bytes stream = Encode(vertices, 16, Channels(16, 3));
  Bytes out(vertices.size());
  for (size_t n = 0; n < stream.size(); n += 3) {
    const Bytes cut(stream.begin(), stream.begin() + long(n));
    EXPECT_FALSE(DecodeMeshoptVertexV1(cut, 16, out)) << n;
  }
  for (size_t i = 0; i < stream.size(); ++i) {
    Bytes changed = stream;
    changed[i] ^= 0x55;
    (void)DecodeMeshoptVertexV1(changed, 16, out);  // for sanitizers: any answer, nothing read or written outside
  }
  for (const uint64_t stride : {0u, 2u, 6u, 260u}) EXPECT_FALSE(DecodeMeshoptVertexV1(stream, stride, out));
}

TEST(MeshoptVertexV1, ColoursComeFromLumaAndChroma) {
  // Y, Co, Cg and alpha of 8 bits: the highest set bit of alpha, 0x80, says so.
  const auto decode = [](Bytes in) {
    MeshoptView view;
    view.count = 1;
    view.byte_stride = 4;
    view.mode = "ATTRIBUTES";
    view.filter = "COLOR";
    view.khr = true;
    const auto decoded = DecodeMeshopt(Encode(in, 4, {{0, 0}}), view);
    EXPECT_TRUE(decoded.ok()) << decoded.status();
    return decoded.value_or(Bytes());
  };
  EXPECT_EQ(decode({100, 0, 0, 0xff}), (Bytes{100, 100, 100, 255}));
  EXPECT_EQ(decode({100, 20, uint8_t(-10), 0xff}), (Bytes{130, 90, 90, 255}));
  EXPECT_EQ(decode({7, 0, 0, 0x0f}), (Bytes{119, 119, 119, 255})) << "four bits";
}

}  // namespace
}  // namespace voxelpipe
