#include "support/meshes/zip_maker.h"

#include <zlib.h>

namespace voxelpipe::testing {
namespace {

template <typename T>
void PutNumber(std::string& out, T value) {
  for (size_t i = 0; i < sizeof value; ++i) out += char(value >> (8 * i));
}

std::string Deflate(const std::string& content) {
  z_stream stream{};
  deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
  std::string out(deflateBound(&stream, content.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(content.data()));
  stream.avail_in = uInt(content.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = uInt(out.size());
  deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

}  // namespace

void ZipMaker::Add(const std::string& name, const std::string& content, bool deflate) {
  const std::string packed = deflate ? Deflate(content) : content;
  const auto crc = uint32_t(crc32(0, reinterpret_cast<const Bytef*>(content.data()), uInt(content.size())));
  Entry entry{
      name, crc, uint32_t(packed.size()), uint32_t(content.size()), uint32_t(body_.size()), uint16_t(deflate ? 8 : 0)};
  PutNumber(body_, uint32_t{0x04034b50});
  PutNumber(body_, uint16_t{20});
  PutNumber(body_, uint16_t{0});
  PutNumber(body_, entry.method);
  PutNumber(body_, uint32_t{0});
  PutNumber(body_, entry.crc);
  PutNumber(body_, entry.packed);
  PutNumber(body_, entry.size);
  PutNumber(body_, uint16_t(name.size()));
  PutNumber(body_, uint16_t{0});
  body_ += name + packed;
  entries_.push_back(std::move(entry));
}

std::string ZipMaker::Bytes() const {
  std::string out = body_;
  for (const Entry& entry : entries_) {
    PutNumber(out, uint32_t{0x02014b50});
    PutNumber(out, uint32_t{20 | 20 << 16});
    PutNumber(out, uint16_t{0});
    PutNumber(out, entry.method);
    PutNumber(out, uint32_t{0});
    PutNumber(out, entry.crc);
    PutNumber(out, entry.packed);
    PutNumber(out, entry.size);
    PutNumber(out, uint16_t(entry.name.size()));
    for (int i = 0; i < 12; ++i) out += '\0';
    PutNumber(out, entry.offset);
    out += entry.name;
  }
  const auto bytes = uint32_t(out.size() - body_.size());
  PutNumber(out, uint32_t{0x06054b50});
  PutNumber(out, uint32_t{0});
  PutNumber(out, uint16_t(entries_.size()));
  PutNumber(out, uint16_t(entries_.size()));
  PutNumber(out, bytes);
  PutNumber(out, uint32_t(body_.size()));
  PutNumber(out, uint16_t{0});
  return out;
}

ZipMaker Package3mf(const std::string& model) {
  ZipMaker zip;
  zip.Add("[Content_Types].xml", "<?xml version=\"1.0\"?><Types/>");
  zip.Add("_rels/.rels",
          "<?xml version=\"1.0\"?><Relationships "
          "xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\"><Relationship Id=\"r\" "
          "Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\" Target=\"/3D/3dmodel.model\"/>"
          "</Relationships>",
          false);
  zip.Add("3D/3dmodel.model", model);
  return zip;
}

std::string Model3mf(const std::string& resources, const std::string& build, const std::string& attributes) {
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model "
         "xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\" "
         "xmlns:m=\"http://schemas.microsoft.com/3dmanufacturing/material/2015/02\" "
         "xmlns:p=\"http://schemas.microsoft.com/3dmanufacturing/production/2015/06\" xmlns:x=\"http://example.org\" " +
         attributes + ">\n<resources>\n" + resources + "</resources>\n<build>" + build + "</build>\n</model>\n";
}

}  // namespace voxelpipe::testing
