// Labels with names and colours: one legend for pictures, the viewer and formats of labelled voxels.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "encode/preview/preview_canvas.h"
#include "job/part_table.h"
#include "job/request.h"

namespace voxelpipe {

// True if the values of a target of a result of this kind are labels of parts: of shader `label`, one component, by a
// blend that keeps them (replace, first, min, max; buckets blend nothing), and not bits.
bool HoldsLabels(const TargetSpec& spec, ResultKind kind);

// The colour of a label, sRGB 0xRRGGBB: the same one in every picture and file.
uint32_t LabelColour(uint32_t label);

struct LegendEntry {
  uint32_t label = 0;
  uint32_t rgb = 0;                    // LabelColour
  uint32_t parts = 0;                  // that have this label
  uint64_t triangles = 0, voxels = 0;  // of these parts together; voxels that they own, 0 where parts are not filled
  std::string name = {};               // of the first of these parts, as CleanText makes it; empty: it has none
};

// An entry a label, ascending. Empty where the result has no parts.
std::vector<LegendEntry> LegendOf(const PartTable& parts);
// The most memory that it takes, for a table of this shape.
uint64_t LegendBytes(const PartShape& shape);

// Draws labels, colours and names into the top left corner of `view`, as many as its upper two thirds hold, and the
// number of the others. Letters are those of Canvas::Text; a character that it does not have is a '?'.
void DrawLegend(std::span<const LegendEntry> legend, const PixelRect& view, Canvas& canvas);

}  // namespace voxelpipe
