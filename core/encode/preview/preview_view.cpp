#include "encode/preview/preview_view.h"

#include <array>
#include <charconv>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

struct NamedView {
  std::string_view name;
  PreviewView view;
};
constexpr std::array<NamedView, 7> kNamedViews = {{{"iso", {}},
                                                   {"front", {0, 0}},
                                                   {"back", {180, 0}},
                                                   {"left", {-90, 0}},
                                                   {"right", {90, 0}},
                                                   {"top", {0, 90}},
                                                   {"bottom", {0, -90}}}};

// Exact for multiples of 90, so that rays along an axis have a direction of exact zeros.
double Cosine(double degrees) {
  const double turned = std::fmod(std::abs(degrees), 360.0);
  if (turned == 0) return 1;
  if (turned == 90 || turned == 270) return 0;
  if (turned == 180) return -1;
  return std::cos(turned * 0.017453292519943295);
}

double Sine(double degrees) {
  return Cosine(degrees - 90);
}

bool ParseAngle(std::string_view text, double& angle) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), angle);
  return error == std::errc() && end == text.data() + text.size();
}

}  // namespace

absl::StatusOr<PreviewView> ParseView(std::string_view text) {
  for (const NamedView& known : kNamedViews) {
    if (text == known.name) return known.view;
  }
  PreviewView view;
  const size_t comma = text.find(',');
  if (comma != std::string_view::npos && ParseAngle(text.substr(0, comma), view.azimuth) &&
      ParseAngle(text.substr(comma + 1), view.elevation) && CheckView(view).ok()) {
    return view;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("'", std::string(text),
                   "': a view is iso, front, back, left, right, top, bottom, or AZIMUTH,ELEVATION in degrees, -360 to "
                   "360 from +Z towards +X and -90 to 90 above the horizon"));
}

absl::Status CheckView(const PreviewView& view) {
  // Also false for NaN.
  if (std::abs(view.azimuth) <= 360 && std::abs(view.elevation) <= 90) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("preview view ", view.azimuth, ",", view.elevation,
                                                 ": the azimuth takes -360 to 360 degrees, the elevation -90 to 90"));
}

ViewFrame FrameOf(const PreviewView& view) {
  const double cos_a = Cosine(view.azimuth), sin_a = Sine(view.azimuth);
  const double cos_e = Cosine(view.elevation), sin_e = Sine(view.elevation);
  ViewFrame frame;
  frame.right = {cos_a, 0, -sin_a};
  frame.eye = {cos_e * sin_a, sin_e, cos_e * cos_a};
  frame.up = Cross(frame.eye, frame.right);
  return frame;
}

}  // namespace voxelpipe
