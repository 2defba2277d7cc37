// Files of the formats besides glTF and Draco.
#include <cstring>
#include <string>
#include <string_view>

#include "fuzz/mesh/seeds.h"
#include "support/meshes/zip_maker.h"

namespace voxelpipe::fuzz {
namespace {

using Files = std::vector<std::vector<uint8_t>>;
using testing::Shape;

std::vector<uint8_t> FileOf(std::string_view text) {
  return {text.begin(), text.end()};
}

template <typename T>
void PutValue(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

std::string TextOf(const Vec3f& p) {
  return std::to_string(p.x) + " " + std::to_string(p.y) + " " + std::to_string(p.z);
}

// The corners of a U that no float holds.
constexpr const char* kConcave[] = {"0 0 0.1",   "3.3 0 0.1", "3.3 3 0.1", "2 3 0.1",
                                    "2.2 1 0.1", "1 1 0.1",   "1 3 0.1",   "0 3.3 0.1"};

std::string PngDataUri() {
  const testing::ByteVector png = testing::MakePng(2, 2, testing::ByteVector(16, 120));
  return "data:image/png;name=a.png;base64," + testing::Base64(png);
}

}  // namespace

Files StlFiles() {
  const Shape cube = testing::CubeShape();
  std::string binary(80, ' '), text = "solid cube\n";
  PutValue(binary, uint32_t(cube.indices.size() / 3));
  for (size_t i = 0; i < cube.indices.size(); i += 3) {
    for (int n = 0; n < 3; ++n) PutValue(binary, 0.0f);
    text += "facet normal 0 0 1\n outer loop\n";
    for (size_t c = 0; c < 3; ++c) {
      const Vec3f& p = cube.positions[cube.indices[i + c]];
      PutValue(binary, p);
      text += "  vertex " + TextOf(p) + "\n";
    }
    PutValue(binary, uint16_t{0});
    text += " endloop\nendfacet\n";
  }
  return {
      FileOf(binary), FileOf(text + "endsolid cube\n"),
      FileOf("solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nend loop\nend facet\n"
             "end solid\n")};
}

Files PlyFiles() {
  const Shape cube = testing::CubeShape();
  const std::string faces = std::to_string(cube.indices.size() / 3);
  const std::string header =
      "element vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty int heat\n"
      "element face " +
      faces + "\nproperty list uchar int vertex_indices\nend_header\n";
  std::string text = "ply\nformat ascii 1.0\n" + header;
  std::string binary = "ply\nformat binary_little_endian 1.0\n" + header;
  for (const Vec3f& p : cube.positions) {
    text += TextOf(p) + " 255 128 0 7\n";
    PutValue(binary, p);
    for (const uint8_t c : {255, 128, 0}) PutValue(binary, c);
    PutValue(binary, int32_t{7});
  }
  for (size_t i = 0; i < cube.indices.size(); i += 3) {
    text += "3";
    PutValue(binary, uint8_t{3});
    for (size_t c = 0; c < 3; ++c) {
      text += " " + std::to_string(cube.indices[i + c]);
      PutValue(binary, int32_t(cube.indices[i + c]));
    }
    text += "\n";
  }
  // A concave face before its vertices, in double, and strips.
  std::string late =
      "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 8\n"
      "property double x\nproperty double y\nproperty double z\nelement tristrips 1\n"
      "property list int int vertex_indices\nend_header\n8 0 1 2 3 4 5 6 7\n";
  for (const char* vertex : kConcave) late += std::string(vertex) + "\n";
  return {FileOf(text), FileOf(binary), FileOf(late + "7 0 1 2 -1 3 4 5\n")};
}

Files OffFiles() {
  std::string concave = "OFF\n8\n1 0\n";  // with lines that end anywhere
  for (const char* vertex : kConcave) concave += std::string(vertex) + " ";
  return {
      FileOf(concave + "\n8 0 1 2 3\n4 5 6 7\n"),
      FileOf("COFF\n4 2 0\n0 0 0 255 0 0\n1 0 0 0 255 0\n1 1 0 0 0 255\n0 1 0 1.0 0.5 0.25 1\n4 0 1 2 3\n3 0 1 2\n"),
      FileOf("STNOFF # a comment\n3 1 3\n0 0 0 0 0 1 0 0\n1 0 0 0 0 1 1 0\n0 1 0 0 0 1 0 1\n3 0 1 2 255 0 0\n")};
}

Files ObjFiles() {
  const std::string corners =
      "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 1 1 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n";
  const std::string library =
      "newmtl a\nKd 0.5 1 0\nd 0.5\nmap_Kd -s 2 2 1 -clamp on " + PngDataUri() + "\nnewmtl b\nKe 1 1 1\nmap_Ke a.png\n";
  const std::vector<uint8_t> bytes = FileOf(library);
  std::string concave;
  for (const char* vertex : kConcave) concave += "v " + std::string(vertex) + "\n";
  return {FileOf("mtllib data:model/mtl;base64," + testing::Base64(bytes) + "\n" + corners +
                 "usemtl a\nf 1/1/1 2/2/1 3/3/1 4/1/1\nusemtl b\ng x\nf -1 -2 \\\n-3\nf 1//1 2//1 3//1\n"),
          FileOf("mtllib a.mtl\no thing\n" + corners + "usemtl c\nf 1/1 2/2 3/3\nl 1 2\np 1\ns off\n"),
          FileOf(concave + "f 1 2 3 4 5 6 7 8\nf 3 4 5 6 7 8 1 2\n")};
}

Files ThreemfFiles() {
  const Shape cube = testing::CubeShape();
  std::string vertices, triangles;
  for (const Vec3f& p : cube.positions) {
    vertices += "<vertex x=\"" + std::to_string(p.x) + "\" y=\"" + std::to_string(p.y) + "\" z=\"" +
                std::to_string(p.z) + "\"/>";
  }
  for (size_t i = 0; i < cube.indices.size(); i += 3) {
    triangles += "<triangle v1=\"" + std::to_string(cube.indices[i]) + "\" v2=\"" +
                 std::to_string(cube.indices[i + 1]) + "\" v3=\"" + std::to_string(cube.indices[i + 2]) + "\" pid=\"" +
                 (i % 2 == 0 ? "5" : "6") + "\" p1=\"0\"/>";
  }
  const std::string model = testing::Model3mf(
      "<basematerials id=\"5\"><base name=\"red\" displaycolor=\"#FF0000\"/></basematerials><m:texture2d id=\"3\" "
      "path=\"/3D/a.png\" contenttype=\"image/png\"/><m:texture2dgroup id=\"6\" texid=\"3\"><m:tex2coord u=\"0\" "
      "v=\"1\"/></m:texture2dgroup><object id=\"1\"><mesh><vertices>" +
          vertices + "</vertices><triangles>" + triangles +
          "</triangles></mesh></object><object id=\"2\"><components><component objectid=\"1\" transform=\"0 1 0 -1 0 0 "
          "0 0 "
          "1 1 2 3\"/><component objectid=\"1\"/></components></object>",
      "<item objectid=\"2\"/>", "unit=\"meter\"");
  Files files;
  for (const bool deflate : {false, true}) {
    testing::ZipMaker zip;
    zip.Add("[Content_Types].xml", "<Types/>", deflate);
    zip.Add("3D/3dmodel.model", model, deflate);
    const testing::ByteVector png = testing::MakePng(2, 2, testing::ByteVector(16, 120));
    zip.Add("3D/a.png", {png.begin(), png.end()}, false);
    zip.Add("Metadata/Slic3r_PE_model.config",
            "<config><object id=\"1\"><volume><metadata key=\"name\" value=\"a\"/><metadata key=\"volume_type\" "
            "value=\"NegativeVolume\"/></volume></object></config>",
            deflate);
    files.push_back(FileOf(zip.Bytes()));
  }
  return files;
}

}  // namespace voxelpipe::fuzz
