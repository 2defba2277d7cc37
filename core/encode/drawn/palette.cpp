#include "encode/drawn/palette.h"

#include <algorithm>
#include <array>
#include <utility>

#include "job/job_work.h"

namespace voxelpipe {
namespace {

struct Colour {
  uint32_t rgb;
  uint64_t count;

  uint32_t channel(int shift) const { return (rgb >> shift) & 255; }
};

struct Box {
  size_t begin, end;  // of the list of colours
  int shift = 0;      // of the channel with the longest side
  double weight = 0;  // of a split; 0: one colour
};

Box MakeBox(const std::vector<Colour>& colours, size_t begin, size_t end) {
  Box box{begin, end};
  double count = 0;
  for (size_t i = begin; i < end; ++i) count += double(colours[i].count);
  for (const int shift : {16, 8, 0}) {
    const auto [least, most] =
        std::minmax_element(colours.begin() + ptrdiff_t(begin), colours.begin() + ptrdiff_t(end),
                            [shift](const Colour& a, const Colour& b) { return a.channel(shift) < b.channel(shift); });
    const double weight = count * double(most->channel(shift) - least->channel(shift));
    if (weight > box.weight) {
      box.weight = weight;
      box.shift = shift;
    }
  }
  return box;
}

// Divides the box along its longest side, as if its colours were sorted by that channel. Out: where the second half
// begins; both halves have colours.
size_t SplitOf(std::vector<Colour>& colours, const Box& box) {
  std::array<uint64_t, 256> counts{};
  uint64_t all = 0, before = 0;
  for (size_t i = box.begin; i < box.end; ++i) {
    counts[colours[i].channel(box.shift)] += colours[i].count;
    all += colours[i].count;
  }
  // The split is at the values of one number, `middle`, which are sorted: at most 65,536, for each occurs once.
  uint32_t middle = 0;
  while (2 * (before + counts[middle]) < all) before += counts[middle++];
  const auto end = colours.begin() + ptrdiff_t(box.end);
  const auto first = std::partition(colours.begin() + ptrdiff_t(box.begin), end,
                                    [&](const Colour& c) { return c.channel(box.shift) < middle; });
  const auto last = std::partition(first, end, [&](const Colour& c) { return c.channel(box.shift) == middle; });
  std::sort(first, last, [](const Colour& a, const Colour& b) { return a.rgb < b.rgb; });
  auto split = size_t(first - colours.begin());
  while (split + 1 < box.end && (split == box.begin || 2 * before < all)) before += colours[split++].count;
  return split;
}

uint32_t MeanOf(const std::vector<Colour>& colours, const Box& box) {
  std::array<double, 3> sums{};
  double count = 0;
  for (size_t i = box.begin; i < box.end; ++i) {
    for (size_t c = 0; c < 3; ++c) sums[c] += double(colours[i].channel(int(16 - 8 * c))) * double(colours[i].count);
    count += double(colours[i].count);
  }
  uint32_t rgb = 0;
  for (const double sum : sums) rgb = rgb << 8 | uint32_t(sum / count + 0.5);
  return rgb;
}

}  // namespace

absl::StatusOr<Palette> MakePalette(const absl::flat_hash_map<uint32_t, uint64_t>& occurrences, size_t size,
                                    const JobContext* job) {
  Palette palette;
  palette.memory = MemoryCharge(&MemoryOf(job));
  MemoryCharge list(&MemoryOf(job));
  ChargedGrowth growth(MemoryOf(job), TableEntryBytes(2 * sizeof(uint32_t)), "a palette:");
  if (absl::Status s = list.Grow(occurrences.size(), sizeof(Colour), "a palette:"); !s.ok()) return s;
  if (absl::Status s = growth.Reach(occurrences.size(), palette.nearest); !s.ok()) return s;
  palette.memory.Absorb(growth.TakeCharge());
  JobPoll poll(job);
  std::vector<Colour> colours;
  colours.reserve(occurrences.size());
  for (const auto& [rgb, count] : occurrences) {
    colours.push_back({rgb, count});
    if (absl::Status s = poll.Add(1); !s.ok()) return s;
  }
  std::vector<Box> boxes;
  if (colours.size() <= size) {
    std::sort(colours.begin(), colours.end(), [](const Colour& a, const Colour& b) { return a.rgb < b.rgb; });
    for (size_t i = 0; i < colours.size(); ++i) boxes.push_back({i, i + 1});
  } else {
    boxes.push_back(MakeBox(colours, 0, colours.size()));
  }
  while (boxes.size() < std::min(size, colours.size())) {
    if (absl::Status s = CheckJob(job); !s.ok()) return s;
    const auto widest =
        std::max_element(boxes.begin(), boxes.end(), [](const Box& a, const Box& b) { return a.weight < b.weight; });
    const Box box = *widest;
    const size_t split = SplitOf(colours, box);
    *widest = MakeBox(colours, box.begin, split);
    boxes.push_back(MakeBox(colours, split, box.end));
  }
  for (const Box& box : boxes) {
    for (size_t i = box.begin; i < box.end; ++i) {
      palette.nearest[colours[i].rgb] = uint8_t(palette.colours.size());
      if (absl::Status s = poll.Add(1); !s.ok()) return s;
    }
    palette.colours.push_back(MeanOf(colours, box));
  }
  return palette;
}

}  // namespace voxelpipe
