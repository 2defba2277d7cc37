// Draco 1.5 does not check the number of orientations that its prediction of texture coordinates reads from the stream,
// although there is at most one for each corner of the mesh: 224 bytes keep it busy for 10 s. The count follows
// compressed values, so only the decoder can find it. These members of Draco's templates replace the library's own,
// which are called through virtual function tables: the same steps, with the count checked first. draco_test.cpp proves
// that these run.
#include <draco/compression/attributes/prediction_schemes/mesh_prediction_scheme_data.h>
#include <draco/compression/attributes/prediction_schemes/mesh_prediction_scheme_tex_coords_decoder.h>
#include <draco/compression/attributes/prediction_schemes/mesh_prediction_scheme_tex_coords_portable_decoder.h>
#include <draco/compression/attributes/prediction_schemes/prediction_scheme_wrap_decoding_transform.h>
#include <draco/compression/bit_coders/rans_bit_decoder.h>
#include <draco/core/varint_decoding.h>
#include <draco/mesh/corner_table.h>
#include <draco/mesh/mesh_attribute_corner_table.h>

#include <cstdint>

#include "load/decode/draco_orientations.h"

namespace draco {
namespace {

using Wrap = PredictionSchemeWrapDecodingTransform<int32_t, int32_t>;
using Data = MeshPredictionSchemeData<CornerTable>;
using AttributeData = MeshPredictionSchemeData<MeshAttributeCornerTable>;

// `count` orientations, each coded as equal to the one before or not.
template <typename Set>
bool DecodeOrientations(DecoderBuffer* buffer, uint32_t count, const Set& set) {
  bool last = true;
  RAnsBitDecoder decoder;
  if (!decoder.StartDecoding(buffer)) return false;
  for (uint32_t i = 0; i < count; ++i) {
    if (!decoder.DecodeNextBit()) last = !last;
    set(i, last);
  }
  decoder.EndDecoding();
  return true;
}

bool ReadCount(DecoderBuffer* buffer, uint32_t& count) {
  return buffer->Decode(&count);
}

// In the form of the older of the two predictions.
bool ReadOldCount(DecoderBuffer* buffer, uint32_t& count) {
  const bool fixed = buffer->bitstream_version() < DRACO_BITSTREAM_VERSION(2, 2);
  return (fixed ? buffer->Decode(&count) : DecodeVarint(&count, buffer)) && count > 0;
}

}  // namespace

// Four copies, because only members of a decoder may access its private members.
template <>
bool MeshPredictionSchemeTexCoordsPortableDecoder<int32_t, Wrap, Data>::DecodePredictionData(DecoderBuffer* buffer) {
  uint32_t count = 0;
  if (!ReadCount(buffer, count) || count > uint32_t(this->mesh_data().corner_table()->num_corners())) return false;
  predictor_.ResizeOrientations(int(count));
  return DecodeOrientations(buffer, count,
                            [&](uint32_t i, bool value) { predictor_.set_orientation(int(i), value); }) &&
         MeshPredictionSchemeDecoder<int32_t, Wrap, Data>::DecodePredictionData(buffer);
}

template <>
bool MeshPredictionSchemeTexCoordsPortableDecoder<int32_t, Wrap, AttributeData>::DecodePredictionData(
    DecoderBuffer* buffer) {
  uint32_t count = 0;
  if (!ReadCount(buffer, count) || count > uint32_t(this->mesh_data().corner_table()->num_corners())) return false;
  predictor_.ResizeOrientations(int(count));
  return DecodeOrientations(buffer, count,
                            [&](uint32_t i, bool value) { predictor_.set_orientation(int(i), value); }) &&
         MeshPredictionSchemeDecoder<int32_t, Wrap, AttributeData>::DecodePredictionData(buffer);
}

template <>
bool MeshPredictionSchemeTexCoordsDecoder<int32_t, Wrap, Data>::DecodePredictionData(DecoderBuffer* buffer) {
  uint32_t count = 0;
  if (!ReadOldCount(buffer, count) || count > uint32_t(this->mesh_data().corner_table()->num_corners())) return false;
  orientations_.resize(count);
  return DecodeOrientations(buffer, count, [&](uint32_t i, bool value) { orientations_[i] = value; }) &&
         MeshPredictionSchemeDecoder<int32_t, Wrap, Data>::DecodePredictionData(buffer);
}

template <>
bool MeshPredictionSchemeTexCoordsDecoder<int32_t, Wrap, AttributeData>::DecodePredictionData(DecoderBuffer* buffer) {
  uint32_t count = 0;
  if (!ReadOldCount(buffer, count) || count > uint32_t(this->mesh_data().corner_table()->num_corners())) return false;
  orientations_.resize(count);
  return DecodeOrientations(buffer, count, [&](uint32_t i, bool value) { orientations_[i] = value; }) &&
         MeshPredictionSchemeDecoder<int32_t, Wrap, AttributeData>::DecodePredictionData(buffer);
}

}  // namespace draco

namespace voxelpipe {

void UseBoundedOrientations() {}

}  // namespace voxelpipe
