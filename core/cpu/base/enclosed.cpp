// The flood: two sweeps over all rows, then a queue of words of 64 voxels.
//
// Source: the scan-line seed fill (A. R. Smith, "Tangent Fill", 1979) on words of 64 voxels. Changed: an addition
// carries all seeds of a row upwards through its open runs. What the sweeps leave is a queue of words that have an open
// voxel beside a reached one. A visit fills at least one run of a word whole, and no run twice: so visits are in
// proportion to the voxels for every maze.
//
// Blocks of layers are worked on in parallel. Those of even number run while the others rest, and the other way round:
// a block may read the layers beside it. The result does not depend on the order: it is the least fixed point.
#include "cpu/base/enclosed.h"

#include <algorithm>
#include <cstring>
#include <vector>

#include "base/parallel.h"
#include "cpu/base/index_set.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kBlockBytes = 128 << 10;        // of bits: a block and its shell stay in the L2 cache
constexpr int64_t kWordsBetweenChecks = 1 << 15;  // of the job, in a sweep
constexpr int64_t kVisitsBetweenChecks = 1 << 13;
constexpr int64_t kSweptInAVisit = 8;  // words that are swept in the time of a visit

int64_t LayersOfBlock(const std::array<int64_t, 3>& dims) {
  return std::max<int64_t>(1, kBlockBytes / int64_t(BitGrid::BytesFor({dims[0], dims[1], 1})));
}

// The open voxels of a word above a seed of their run, and the seeds. `seeds` are open.
uint64_t UpFrom(uint64_t open, uint64_t seeds) {
  return (open & ~(open + seeds)) | seeds;
}

// The same below the seeds.
uint64_t DownFrom(uint64_t open, uint64_t seeds) {
  for (int step = 1; step < 64; step *= 2) {
    seeds |= open & (seeds >> step);
    open &= open >> step;
  }
  return seeds;
}

// Layers [begin, end) of the grid. A word's number in it is that of its row, from the block's first one, times the
// words of a row, plus its place in the row.
struct Block {
  Block(int64_t b, int64_t e, int64_t layer_words)
      : begin(b),
        end(e),
        words((e - b) * layer_words),
        pending(words),
        sent{IndexSet(layer_words), IndexSet(layer_words)} {}
  int64_t begin, end, words;
  IndexSet pending;  // words with an open voxel beside a reached one
  // The same of the layers below and above the block, by the place in the layer. They are the neighbours', who take
  // them.
  IndexSet sent[2];
};

class Flood {
 public:
  Flood(const std::array<int64_t, 3>& dims, const BitGrid& shell, BitGrid& unreached, int64_t layers,
        const JobContext& job)
      : ny_(dims[1]),
        nz_(dims[2]),
        row_words_(shell.words_per_row()),
        words_((row_words_ + 1) / 2),
        last_mask_(shell.last_word_mask()),
        shell_(shell.row(0).data()),
        unreached_(unreached.row(0).data()),
        job_(job),
        nothing_(size_t(row_words_), ~0u) {
    blocks_.reserve(size_t((nz_ + layers - 1) / layers));
    for (int64_t z = 0; z < nz_; z += layers) blocks_.emplace_back(z, std::min(nz_, z + layers), ny_ * words_);
  }

  absl::Status Run() {
    std::vector<int64_t> even, odd;
    for (int64_t b = 0; b < int64_t(blocks_.size()); ++b) (b % 2 == 0 ? even : odd).push_back(b);
    absl::Status s = Each(even, [&](int64_t b) { Sweep(b, true); });
    if (s.ok()) {
      s = Each(odd, [&](int64_t b) {
        Sweep(b, true);
        Drain(b);
      });
    }
    for (std::vector<int64_t> active = even; s.ok() && !active.empty(); active = SentTo(active)) {
      s = Each(active, [&](int64_t b) {
        // The front is broad: sweeps are quicker than so many visits.
        if (Receive(b) * kSweptInAVisit >= blocks_[size_t(b)].words) Sweep(b, false);
        Drain(b);
      });
    }
    return s;
  }

 private:
  // Out: OK, or why the job ended; the work is then incomplete.
  template <typename Body>
  absl::Status Each(const std::vector<int64_t>& blocks, const Body& body) {
    if (blocks.size() == 1) {  // a long way through many blocks: waking threads would take longer
      body(blocks[0]);
      return job_.Check();
    }
    absl::Status s = ParallelChunks(int64_t(blocks.size()), 1, job_, [&](int64_t begin, int64_t end) {
      for (int64_t i = begin; i < end; ++i) body(blocks[size_t(i)]);
    });
    return s.ok() ? job_.Check() : s;
  }

  // In and out: numbers of blocks, ascending.
  std::vector<int64_t> SentTo(const std::vector<int64_t>& blocks) const {
    std::vector<int64_t> to;
    const auto add = [&](int64_t b) {
      if (to.empty() || to.back() != b) to.push_back(b);
    };
    for (const int64_t b : blocks) {
      if (!blocks_[size_t(b)].sent[0].empty()) add(b - 1);
      if (!blocks_[size_t(b)].sent[1].empty()) add(b + 1);
    }
    return to;
  }

  // Rows are numbered y + ny*z; they have 32-bit words, the last 64-bit word of a row may be half a one.
  uint64_t Load(const uint32_t* words, int64_t row, int64_t w) const {
    const uint32_t* const at = words + row * row_words_ + 2 * w;
    if (2 * w + 1 == row_words_) return *at;
    uint64_t word = 0;
    std::memcpy(&word, at, sizeof word);
    return word;
  }
  void Store(int64_t row, int64_t w, uint64_t word) {
    uint32_t* const at = unreached_ + row * row_words_ + 2 * w;
    if (2 * w + 1 == row_words_) {
      *at = uint32_t(word);
    } else {
      std::memcpy(at, &word, sizeof word);
    }
  }
  const uint32_t* Unreached(int64_t row) const { return unreached_ + row * row_words_; }
  const uint32_t* Shell(int64_t row) const { return shell_ + row * row_words_; }
  uint64_t Open(int64_t row, int64_t w) const { return Load(unreached_, row, w) & ~Load(shell_, row, w); }

  // In: a row and the unreached voxels of two neighbours. True if one of its open voxels is beside a reached one.
  bool Reaches(const uint32_t* a, const uint32_t* b, int64_t row) const {
    const uint32_t* const unreached = Unreached(row);
    const uint32_t* const shell = Shell(row);
    uint32_t any = 0;
    for (int64_t w = 0; w < row_words_; ++w) any |= ~(a[w] & b[w]) & unreached[w] & ~shell[w];
    return any != 0;
  }

  // Fills the runs of a row that are beside a reached voxel of two neighbours. `first`: the row's words are not set
  // yet; its ends are beside the layer around the grid.
  void FillRow(const uint32_t* a, const uint32_t* b, int64_t row, bool first) {
    const auto rest = [&](int64_t w) {
      if (!first) return Open(row, w);
      const uint64_t shell = Load(shell_, row, w);
      if (w + 1 < words_) return ~shell;
      return ~shell & (row_words_ % 2 != 0 ? last_mask_ : uint64_t{last_mask_} << 32 | ~0u);
    };
    uint64_t carry = first, left = 0;  // upwards, and what is open after it
    for (int64_t w = 0; w < words_; ++w) {
      const uint64_t open = rest(w), seeds = ~(Load(a, 0, w) & Load(b, 0, w)) & open;
      const uint64_t seeded = open + seeds, sum = seeded + carry;
      carry = uint64_t{seeded < open} | uint64_t{sum < seeded};
      const uint64_t still = open & sum & ~seeds;
      left |= still;
      Store(row, w, Load(shell_, row, w) | still);
    }
    if (left == 0) return;
    uint64_t down = first;  // padding bits count as reached, too
    for (int64_t w = words_; w-- > 0;) {
      uint64_t unreached = Load(unreached_, row, w);
      const uint64_t open = unreached & ~Load(shell_, row, w);
      const uint64_t seeds = (~unreached >> 1 | down << 63) & open;
      if (seeds != 0) {
        unreached &= ~DownFrom(open, seeds);
        Store(row, w, unreached);
      }
      down = ~unreached & 1;
    }
  }

  // True if the row is beside the layer around the grid, so that all its open voxels are reached.
  bool IsOuter(int64_t y, int64_t z) const { return y == 0 || y + 1 == ny_ || z == 0 || z + 1 == nz_; }

  // Fills what two sweeps over the block's rows reach, and queues the words that are next. The first time it sets all
  // words of the block; those of even number are the first of all, and know nothing of their neighbours.
  void Sweep(int64_t number, bool first) {
    Block& block = blocks_[size_t(number)];
    block.pending.Clear();
    const bool knows_neighbours = !first || number % 2 != 0;
    const uint32_t* const nothing = nothing_.data();
    int64_t words = 0;
    const auto over = [&] {
      words += words_;
      if (words < kWordsBetweenChecks) return false;
      words = 0;
      return !job_.Check().ok();
    };
    for (int64_t z = block.begin; z < block.end; ++z) {
      for (int64_t y = 0; y < ny_; ++y) {
        if (over()) return;
        const int64_t row = y + ny_ * z;
        if (IsOuter(y, z)) {
          if (first) std::memcpy(unreached_ + row * row_words_, Shell(row), size_t(row_words_) * sizeof(uint32_t));
          continue;
        }
        const uint32_t* const a = Unreached(row - 1);
        const uint32_t* const b = z > block.begin || knows_neighbours ? Unreached(row - ny_) : nothing;
        if (first || Reaches(a, b, row)) FillRow(a, b, row, first);
      }
    }
    for (int64_t z = block.end; z-- > block.begin;) {
      for (int64_t y = ny_; y-- > 0;) {
        if (over()) return;
        if (IsOuter(y, z)) continue;
        const int64_t row = y + ny_ * z;
        const uint32_t* const a = Unreached(row + 1);
        const uint32_t* const b = z + 1 < block.end || knows_neighbours ? Unreached(row + ny_) : nothing;
        if (!Reaches(a, b, row)) continue;
        FillRow(a, b, row, false);
        // Those before it are still to come.
        PushRow(block, row, row + 1);
        if (z + 1 < block.end) PushRow(block, row, row + ny_);
      }
    }
    if (!knows_neighbours) return;
    for (int64_t y = 1; y + 1 < ny_; ++y) {
      if (over()) return;
      if (block.begin > 0) PushRow(block, y + ny_ * block.begin, y + ny_ * (block.begin - 1));
      if (block.end < nz_) PushRow(block, y + ny_ * (block.end - 1), y + ny_ * block.end);
    }
  }

  // Queues the words of a row that are beside reached voxels of its neighbour `from`.
  void PushRow(Block& block, int64_t from, int64_t row) {
    if (!Reaches(Unreached(from), Unreached(from), row)) return;
    for (int64_t w = 0; w < words_; ++w) Push(block, row, w, ~Load(unreached_, from, w));
  }

  // Queues a word if it has an open voxel among those of `beside`.
  void Push(Block& block, int64_t row, int64_t w, uint64_t beside) {
    if ((beside & Open(row, w)) == 0) return;
    if (row < ny_ * block.begin) {
      block.sent[0].Insert((row - ny_ * (block.begin - 1)) * words_ + w);
    } else if (row >= ny_ * block.end) {
      block.sent[1].Insert((row - ny_ * block.end) * words_ + w);
    } else {
      block.pending.Insert((row - ny_ * block.begin) * words_ + w);
    }
  }

  // Takes the words that the neighbours sent. Out: their number.
  int64_t Receive(int64_t number) {
    Block& block = blocks_[size_t(number)];
    int64_t words = 0;
    const auto take = [&](IndexSet& sent, int64_t layer) {
      for (int64_t word = 0; !sent.empty();) {
        word = sent.Take(word);
        block.pending.Insert(layer * ny_ * words_ + word);
        ++words;
      }
    };
    if (block.begin > 0) take(blocks_[size_t(number - 1)].sent[1], 0);
    if (block.end < nz_) take(blocks_[size_t(number + 1)].sent[0], block.end - block.begin - 1);
    return words;
  }

  void Drain(int64_t number) {
    Block& block = blocks_[size_t(number)];
    int64_t visits = 0;
    for (int64_t word = 0; !block.pending.empty();) {
      if (++visits % kVisitsBetweenChecks == 0 && !job_.Check().ok()) return;
      word = block.pending.Take(word);
      Visit(block, ny_ * block.begin + word / words_, word % words_);
    }
  }

  // Rows that are beside the layer around the grid have no open voxels left: the row has four neighbours.
  void Visit(Block& block, int64_t row, int64_t w) {
    const uint64_t unreached = Load(unreached_, row, w), open = unreached & ~Load(shell_, row, w);
    uint64_t beside = ~(Load(unreached_, row - 1, w) & Load(unreached_, row + 1, w) & Load(unreached_, row - ny_, w) &
                        Load(unreached_, row + ny_, w));
    if (w > 0) beside |= ~Load(unreached_, row, w - 1) >> 63;
    if (w + 1 < words_) beside |= ~Load(unreached_, row, w + 1) << 63;
    const uint64_t filled = DownFrom(open, UpFrom(open, beside & open));
    Store(row, w, unreached & ~filled);
    for (const int64_t next : {row - 1, row + 1, row - ny_, row + ny_}) Push(block, next, w, filled);
    if (w > 0) Push(block, row, w - 1, filled << 63);
    if (w + 1 < words_) Push(block, row, w + 1, filled >> 63);
  }

  const int64_t ny_, nz_, row_words_, words_;  // of a row: of 32 and of 64 voxels
  const uint32_t last_mask_;
  const uint32_t* const shell_;
  uint32_t* const unreached_;
  const JobContext& job_;
  const std::vector<uint32_t> nothing_;  // a row of which nothing is reached
  std::vector<Block> blocks_;
};

}  // namespace

absl::StatusOr<BitGrid> Enclosed(const BitGrid& shell, const std::array<int64_t, 3>& dims, const JobContext& job,
                                 int64_t block_layers) {
  absl::StatusOr<BitGrid> unreached = BitGrid::CreateUncleared(dims);
  if (!unreached.ok()) return unreached.status();
  if (absl::Status s = Flood(dims, shell, *unreached, block_layers > 0 ? block_layers : LayersOfBlock(dims), job).Run();
      !s.ok())
    return s;
  return unreached;
}

uint64_t EnclosedWorkBytes(const std::array<int64_t, 3>& dims) {
  const int64_t layer_words = (dims[0] + 63) / 64 * dims[1], layers = std::min(dims[2], LayersOfBlock(dims));
  const uint64_t block = sizeof(Block) + IndexSet::BytesFor(layers * layer_words) + 2 * IndexSet::BytesFor(layer_words);
  return block * uint64_t((dims[2] + layers - 1) / layers);
}

}  // namespace voxelpipe::cpu
