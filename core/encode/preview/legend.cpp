// Source: M. Okabe, K. Ito, "Color Universal Design", 2008: the colours of the first seven labels, which people without
// normal colour vision tell apart too.
#include "encode/preview/legend.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "base/text.h"

namespace voxelpipe {
namespace {

constexpr std::array<uint32_t, 7> kFirstColours = {0xe69f00, 0x56b4e9, 0x009e73, 0xf0e442,
                                                   0x0072b2, 0xd55e00, 0xcc79a7};

// The 8-bit sRGB colour of a hue, saturation and value, each 0 to 1.
uint32_t FromHsv(double hue, double saturation, double value) {
  const auto channel = [&](int sector) {
    const double k = std::fmod(sector + 6 * hue, 6.0);
    return uint32_t(255 * value * (1 - saturation * std::clamp(std::min(k, 4 - k), 0.0, 1.0)) + 0.5);
  };
  return channel(5) << 16 | channel(3) << 8 | channel(1);
}

// A '?' for every character that is not printable ASCII.
std::string Drawable(const std::string& text) {
  std::string drawable;
  for (const char c : text) {
    if ((uint8_t(c) & 0xc0) == 0x80) continue;  // goes on with a character
    drawable += c >= ' ' && c <= '~' ? c : '?';
  }
  return drawable;
}

std::string Cut(const std::string& text, size_t most) {
  constexpr std::string_view kCut = "...";
  return text.size() <= most ? text : absl::StrCat(text.substr(0, most - std::min(most, kCut.size())), "...");
}

}  // namespace

bool HoldsLabels(const TargetSpec& spec, ResultKind kind) {
  if (spec.shader.name != "label" || spec.components != 1 || spec.format == VoxelFormat::kBit) return false;
  const Blend blend = spec.blend;
  return kind == ResultKind::kBuckets || blend == Blend::kReplace || blend == Blend::kFirst || blend == Blend::kMin ||
         blend == Blend::kMax;
}

uint32_t LabelColour(uint32_t label) {
  if (label >= 1 && label <= kFirstColours.size()) return kFirstColours[label - 1];
  // Hues a golden section apart fill the circle evenly, whatever the number of labels; neighbours differ in lightness.
  constexpr double kGoldenSection = 0.6180339887498949;
  constexpr std::array<std::array<double, 2>, 3> kTones = {{{0.65, 0.95}, {0.85, 0.7}, {0.4, 0.8}}};
  const double hue = std::fmod(label * kGoldenSection, 1.0);
  const auto& [saturation, value] = kTones[label % kTones.size()];
  return FromHsv(hue, saturation, value);
}

std::vector<LegendEntry> LegendOf(const PartTable& parts) {
  std::vector<uint32_t> order(parts.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return parts.label[a] < parts.label[b]; });
  std::vector<LegendEntry> legend;
  legend.reserve(parts.size());
  for (const uint32_t part : order) {
    const uint32_t label = parts.label[part];
    if (legend.empty() || legend.back().label != label) {
      legend.push_back({.label = label, .rgb = LabelColour(label), .name = CleanText(parts.Name(part))});
    }
    LegendEntry& entry = legend.back();
    ++entry.parts;
    entry.triangles += parts.triangles[part];
    if (!parts.voxels.empty()) entry.voxels += parts.voxels[part];
  }
  return legend;
}

uint64_t LegendBytes(const PartShape& shape) {
  return shape.parts * (sizeof(LegendEntry) + 2 * sizeof(uint32_t)) + 2 * shape.name_bytes;
}

void DrawLegend(std::span<const LegendEntry> legend, const PixelRect& view, Canvas& canvas) {
  static const Vec3f ink = FromSrgb(0x2f3740);
  const int dot = std::max(1, view.height / 480), line = 11 * dot, margin = 8 * dot, swatch = 9 * dot;
  const int text_x = view.x + margin + swatch + 4 * dot;
  const auto letters = size_t(std::max(0, (view.x + view.width - text_x - margin) / (6 * dot)));
  const auto lines = size_t(std::max(0, (view.height * 2 / 3 - 2 * margin) / line));
  if (letters == 0 || lines == 0) return;
  const size_t shown = legend.size() <= lines ? legend.size() : lines - 1;
  int y = view.y + margin;
  for (const LegendEntry& entry : legend.first(shown)) {
    const Vec3f colour = FromSrgb(entry.rgb);
    for (int row = 0; row < swatch; ++row) {
      for (int column = 0; column < swatch; ++column) canvas.Blend(view.x + margin + column, y + row, colour, 1);
    }
    const std::string text = absl::StrCat(entry.label, entry.name.empty() ? "" : " ", Drawable(entry.name));
    canvas.Text(text_x, y + dot, dot, Cut(text, letters), ink);
    y += line;
  }
  if (shown < legend.size()) {
    canvas.Text(text_x, y + dot, dot, Cut(absl::StrCat("and ", legend.size() - shown, " more"), letters), ink);
  }
}

}  // namespace voxelpipe
