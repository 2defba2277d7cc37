// The writers of the formats, for the registry. Each takes a path, empty for standard output, and a job that may be
// null; Begin creates the file and refuses results that the format cannot hold with INVALID_ARGUMENT. All of them first
// charge what they allocate to MemoryOf(job) (job/job_work.h), and look at the job every few milliseconds.
#pragma once

#include <memory>
#include <string>

#include "encode/result_file.h"

namespace voxelpipe {

// Dense: each array's bytes as they are, one file a target, and PATH.json, which describes them all and has the table
// of parts (DescribeRaw).
std::unique_ptr<ResultFile> MakeRawFile(const std::string& path, const JobContext* job);
// Dense: one file a target; bits as uint8 0/1.
std::unique_ptr<ResultFile> MakeNpyFile(const std::string& path, const JobContext* job);
// Any kind: target0, target1, ...; sparse: ijk int32 (n, 3) in x, y, z; buckets: ijk, offsets int64 (n + 1), triangle
// uint32 (m); always dims int64 (3), origin and voxel_size float64 (3), index_to_world float64 (4, 4). Of p parts:
// part_label uint32 (p), part_priority int32 (p), part_triangles, part_open_edges, part_odd_columns, part_voxels int64
// (p), part_name_offset int64 (p + 1), part_name uint8 (bytes, UTF-8).
std::unique_ptr<ResultFile> MakeNpzFile(const std::string& path, const JobContext* job);
// Dense: a cell array a target, "target0", ...; of a planar target one a component, "target0_0", ... Bits as UInt8 0/1,
// halves as Float32. Of parts field data: part_label UInt32, part_priority Int32, the counts of .npz Int64, and
// part_name, strings as CleanText makes them. Compressed with zlib in files, not in streams. Memory: 32 MiB, and the
// table of parts.
std::unique_ptr<ResultFile> MakeVtiFile(const std::string& path, const JobContext* job);
// Dense, one target, gzip: components are the first axis, of planar targets the last. Bits as uint8 0/1, halves as
// float. Memory: a piece.
std::unique_ptr<ResultFile> MakeNrrdFile(const std::string& path, const JobContext* job);
// Dense, one target of labels (bits or u8, u16, u32 of one component, up to 2^31 - 1), gzip: a segmentation of 3D
// Slicer, an NRRD as MakeNrrdFile places it. A segment for each label of the parts, if the target holds these
// (HoldsLabels), and for each other label of a voxel but 0; names, colours and boxes of voxels are in the header.
// Memory: the compressed voxels, and up to 65,535 segments.
std::unique_ptr<ResultFile> MakeSegNrrdFile(const std::string& path, const JobContext* job);
// Dense, one target of one component: HDF5 as FDTD codes read a geometry; only in builds with VOXELPIPE_HDF5. Dataset
// `data` (nx, ny, nz), chunked, zlib: of bits and integers int16, the number less 1, so that labels from 1 are
// materials from 0 and 0 is -1, no material (gprMax), up to 32,768; of halves and floats float32 as they are (Meep).
// Attributes of the file: `dx_dy_dz`, `origin`, float64 (3). Group `parts`: the columns of the table (part_json.h),
// names as CleanText makes them. Memory: twice 32 layers, and twice the compressed file.
std::unique_ptr<ResultFile> MakeH5File(const std::string& path, const JobContext* job);
// Dense, one target: NIfTI-1, beyond 32,767 voxels an axis NIfTI-2; components are the fifth axis. Bits as uint8 0/1,
// halves as float32. Memory: a piece, and of interleaved components the compressed ones after the first.
std::unique_ptr<ResultFile> MakeNiftiFile(const std::string& path, const JobContext* job);
// Dense: a directory, an OME-Zarr 0.4 image of each target with the axes c, z, y, x; one target is the root, several
// are groups "target0", ... Bits as uint8 0/1. Coordinates are centres. Levels of half the resolution follow until no
// axis exceeds 256 voxels. "parts" of "voxelpipe" in the attributes of the root is the table of parts (part_json.h); an
// image of their labels has names and colours of these as OME-Zarr's image-label. Memory: a row of chunks of each
// level, twice 16 layers, and the table.
std::unique_ptr<ResultFile> MakeZarrDirectory(const std::string& path, const JobContext* job);

// The following collect the result first (drawn/whole_file.h). All but .ply hold what a picture shows: the solid voxels
// and their colours by the rules of RenderPreview (png_preview.h).

// Any kind: a point for each occupied voxel, or each fragment, with x, y, z of the centre, the index i, j, k, and each
// component of each target; red, green and blue where a picture has colours.
std::unique_ptr<ResultFile> MakePlyFile(const std::string& path, const JobContext* job);
// Any kind: the exposed faces as triangles.
std::unique_ptr<ResultFile> MakeGlbFile(const std::string& path, const JobContext* job);
// The same with faces of one colour merged to rectangles: fewer triangles, but their edges need not end at vertices of
// others, so that renderers may leave single pixels open.
std::unique_ptr<ResultFile> MakeMergedGlbFile(const std::string& path, const JobContext* job);
// Any kind: models of up to 256 voxels a side, up to 255 colours.
std::unique_ptr<ResultFile> MakeVoxFile(const std::string& path, const JobContext* job);
// Any kind: bits alone, in a cube.
std::unique_ptr<ResultFile> MakeBinvoxFile(const std::string& path, const JobContext* job);
// Dense and sparse: a fog volume "density", and of each target that is not bits a grid: Vec3f of the first three
// components, floats of the others. u8 of 3 or 4 components as fractions.
std::unique_ptr<ResultFile> MakeNvdbFile(const std::string& path, const JobContext* job);
// The same grids as MakeNvdbFile, by OpenVDB; only in builds with VOXELPIPE_OPENVDB.
std::unique_ptr<ResultFile> MakeVdbFile(const std::string& path, const JobContext* job);

// Dense and sparse: a page with a viewer (drawn/html.cpp).
std::unique_ptr<ResultFile> MakeHtmlFile(const std::string& path, const JobContext* job);

}  // namespace voxelpipe
