#!/usr/bin/env python3
"""RESULTS.md and the list of experiments are what their script makes; the scripts read, refuse and compare files."""
import contextlib
import io
import json
import os
import tempfile
import unittest

import bench_file
import compare_programs
import compare_results
import import_results
import make_results


def results(rows, **changed):
    return {"title": "t", "date": "d", "commit": "c", "machine": "m", "method": "how", "unit": "ms", "better": "lower",
            "rows": rows, **changed}


ROW = {"case": "bits", "mesh": "cow", "N": 128, "ours": 2.0, "occupied": 10}

CUDA_LOG = """NVIDIA X, 132 multiprocessors

| case | mesh | N | ms | p10-p90 | pass | stretch | result | runs | occupied |
|---|---|---|---|---|---|---|---|---|---|
| bit conservative | cow | 128 | 0.0148 | 0.0145-0.0153 | 0.0250 | 0.0120 | met | 60 | 54107 |
| bit conservative | cow | 512 | DATA_LOSS: 1 voxels occupied, the CPU has 2, in 0.1 ms |

Stages, ms (medians, events between them):
A-buffer thin, nasty 1024: CoarseRaster 0.0029, Resolve 0.216
cuda_bench: 2 rows, 1 met the pass time
"""

SERVICE_LOG = """| backend | batches | clients | call | requests/s | p50 ms | jobs in a batch, mean / most | result |
|---|---|---|---|---|---|---|---|
| cuda | no | 16 | many | 13,223 | 1.20 | 1.0 / 1 | 12345678 |
"""

GRPC_TABLE = """| | ours | bare gRPC, same run | to reach |
|---|---|---|---|
| dense | 3.29 GB/s (132%), 0.51 CPU-s/GB | 2.50 GB/s, 0.61 CPU-s/GB | >= 90 % |
| refused | 7 of 9, other errors none; p50 3.47, p99 15.86, max 21.6 ms | | p99 <= 5 ms |
"""

CALLS = """| call from bytes, cpu | mesh | N | ms | p10-p90 | floor | steps | assimp | result MB |
|---|---|---|---|---|---|---|---|---|
| bits, new, GLB | sphere1k | 64 | 0.27 | 0.26-0.28 | 0.0115 | load 0.06, flatten 0.03 | 4.77 | 0.033 |
"""

LIMITS = CALLS.replace("cpu", "cuda") + """
| whole call | mesh | N | first ms | ms | p10-p90 | stages ms | layers a slab | result MB |
|---|---|---|---|---|---|---|---|---|
| sparse f32 max | cow, kept | 512 | 43.29 | 0.62 | 0.61-0.65 | fine_raster 0.41, plan 0.00 | 512 | 6.3 |
"""

GOOGLE = {"benchmarks": [
    {"name": "cow/thin/128/manual", "wall": 1.234, "wall_p10": 1.2, "wall_p90": 1.3, "cpu": 2, "cpu_min": 1.5,
     "occupied": 7.0, "floor": 0.12345, "stage.plan": 0.25},
    {"name": "cow/yardstick/512/manual", "cpu": 221.4, "ours_cpu": 10.411, "missed": 0.0},
    {"name": "cow/solid/512", "error_message": "RESOURCE_EXHAUSTED"}]}


class Page(unittest.TestCase):
    def test_the_page_and_its_plot_are_what_the_files_make(self):
        self.assertEqual(make_results.main(["--check"]), 0)

    def test_a_row_shows_its_figures_and_the_ratio(self):
        row = {**ROW, "theirs": 5.0, "note": "a|b"}
        made = make_results.table([("x.json", results([row], peer="them"))])
        self.assertIn("| 1 | bits | cow | 128 | 2.0 |  | ms | them | 5.0 | 2.5 | occupied 10, note a\\|b |", made)

    def test_the_first_page_has_every_row_beside_each_commit(self):
        rows = [{"case": "bits", "mesh": "sphere1M", "N": n, "ours": ours, "theirs": 2 * ours}
                for n, ours in ((512, 50.0), (64, 10.0))]
        made = make_results.first_page([(f"results/cpu-beside-{name}.json", results(rows, peer=name)) for name in "AB"])
        self.assertEqual(made.splitlines()[2:5], [
            "| CPU: bits, 512 / 64 | 50.0 / 10.0 ms | A | 100.0 / 20.0 | 2 / 2 | c |",
            "| CPU: bits, 512 / 64 | 50.0 / 10.0 ms | B | 100.0 / 20.0 | 2 / 2 | c |",
            "| CPU: triangle ids, 512 | not measured | | | | |"])

    def test_the_first_page_pairs_figures_where_one_has_no_peer(self):
        rows = [{"case": "bits", "mesh": "sphere1M", "N": 512, "ours": 50.0},
                {"case": "bits", "mesh": "sphere1M", "N": 64, "ours": 10.0, "theirs": 20.0}]
        made = make_results.first_page([("results/cpu-beside-A.json", results(rows, peer="A"))])
        self.assertIn("| CPU: bits, 512 / 64 | 50.0 / 10.0 ms | A | - / 20.0 | - / 2 | c |", made)

    def test_an_experiment_has_a_title_and_a_decision(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "007-bricks.md")
            for content, good in (("# 007: Bricks?\n\n**Decision.** Kept\nhere.\n", True),
                                  ("# 007: Bricks?\n", False),
                                  ("# 008: Bricks?\n\n**Decision.** Kept.\n", False)):
                with open(path, "w", encoding="utf-8") as file:
                    file.write(content)
                if good:
                    self.assertIn("| [007](007-bricks.md) | Bricks? | Kept here. |", make_results.experiments(folder))
                else:
                    with self.assertRaises(bench_file.BadResults):
                        make_results.experiments(folder)

    def test_the_plot_has_a_line_for_each_mesh(self):
        rows = [{**ROW, "mesh": mesh, "N": n, "ours": n / 100} for mesh in ("cow", "bunny") for n in (128, 512)]
        self.assertEqual(make_results.svg([("x.json", results(rows, plot="bits"))]).count("<polyline"), 2)


class Files(unittest.TestCase):
    def test_what_is_written_reads_back(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "x.json")
            bench_file.write(path, results([ROW, {**ROW, "N": 512}]))
            self.assertEqual(bench_file.read(path), results([ROW, {**ROW, "N": 512}]))

    def test_the_ratio_says_how_many_times_better(self):
        self.assertEqual(bench_file.ratio(results([]), {**ROW, "theirs": 6.0}), 3.0)
        self.assertEqual(bench_file.ratio(results([], better="higher"), {**ROW, "theirs": 6.0}), 1 / 3)
        self.assertIsNone(bench_file.ratio(results([]), ROW))

    def test_faults_are_named(self):
        for bad, what in ((results([]), "no rows"), (results([ROW, ROW]), "bits cow 128 is given twice"),
                          (results([{**ROW, "ours": "2"}]), "ours is no number"),
                          (results([ROW], commit=""), "commit"), (results([ROW], better="more"), "better"),
                          (results([{**ROW, "theirs": 1}]), "without a peer")):
            with self.assertRaisesRegex(bench_file.BadResults, what):
                bench_file.check(bad, "x.json")


class Import(unittest.TestCase):
    def made(self, text):
        said = []
        return import_results.of_text(text, said.append), said

    def test_cuda_bench(self):
        made, said = self.made(CUDA_LOG)
        self.assertEqual(made["gpu-kernels"]["rows"], [
            {"case": "bit conservative", "mesh": "cow", "N": 128, "ours": 0.0148, "p10": 0.0145, "p90": 0.0153,
             "theirs": 0.025, "stretch_ms": 0.012, "runs": 60, "occupied": 54107}])
        self.assertEqual(made["gpu-stages"]["rows"][1], {"case": "A-buffer thin: Resolve", "mesh": "nasty", "N": 1024,
                                                         "ours": 0.216})
        self.assertEqual(len(said), 1)
        self.assertIn("DATA_LOSS", said[0])

    def test_the_service_on_a_gpu(self):
        made, _ = self.made(SERVICE_LOG)
        self.assertEqual(made["gpu-service"]["rows"], [
            {"case": "cuda, many calls, 16 clients, no batches", "ours": 13223, "p50_ms": 1.20,
             "jobs_in_a_batch_mean": 1.0, "jobs_in_a_batch_most": 1}])

    def test_whole_calls(self):
        made, _ = self.made(CALLS)
        self.assertEqual(made["cpu-whole-calls"]["rows"], [
            {"case": "bits, new, GLB", "mesh": "sphere1k", "N": 64, "ours": 0.27, "p10": 0.26, "p90": 0.28,
             "theirs": 0.0115, "steps": "load 0.06, flatten 0.03", "assimp": 4.77, "result_mb": 0.033}])

    def test_whole_calls_beside_limits(self):
        made, _ = self.made(LIMITS)
        self.assertEqual(made["gpu-limits"]["rows"], [
            {"case": "sparse f32 max", "mesh": "cow, kept", "N": 512, "first_ms": 43.29, "ours": 0.62, "p10": 0.61,
             "p90": 0.65, "stages_ms": "fine_raster 0.41, plan 0.00", "layers_a_slab": 512, "result_mb": 6.3}])
        self.assertEqual(len(made["gpu-whole-calls"]["rows"]), 1)  # a log of both, as run.sh writes it

    def test_the_service_beside_grpc(self):
        dense, refused = self.made(GRPC_TABLE)[0]["service"]["rows"]
        self.assertEqual((dense["ours"], dense["unit"], dense["theirs"], dense["better"]),
                         (3.29, "GB/s", 2.5, "higher"))
        self.assertEqual((refused["ours"], refused["unit"], refused["better"]), (15.86, "ms", "lower"))

    def test_google_benchmark(self):
        made, said = self.made(json.dumps(GOOGLE))
        self.assertEqual(made["cpu-pipeline"]["rows"], [
            {"case": "thin", "mesh": "cow", "N": 128, "ours": 1.23, "p10": 1.2, "p90": 1.3, "cpu_ms": 2,
             "cpu_min_ms": 1.5, "occupied": 7, "plan_ms": 0.25, "theirs": 0.123}])
        self.assertEqual(made["cpu-plain-loop"]["rows"][0]["theirs"], 221)
        self.assertNotIn("cpu-openvdb", made)
        self.assertEqual(len(said), 2)  # the error, and that OpenVDB is missing

    def test_a_log_becomes_files_that_can_be_read(self):
        with tempfile.TemporaryDirectory() as folder:
            log = os.path.join(folder, "bench.log")
            with open(log, "w", encoding="utf-8") as file:
                file.write(CUDA_LOG)
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                self.assertEqual(import_results.main([log, "--out", folder, "--machine", "m", "--commit", "c"]), 0)
                self.assertEqual(import_results.main([bench_file.__file__, "--out", folder]), 2)
            self.assertEqual(bench_file.read(os.path.join(folder, "gpu-kernels.json"))["machine"], "m")


class Compare(unittest.TestCase):
    def flags(self, old, new, tolerance=0.15, own=None):
        return [row[4] for row in compare_results.compare(old, new, tolerance, own or {})]

    def test_a_row_is_worse_beyond_its_tolerance(self):
        old = results([ROW])
        self.assertEqual(self.flags(old, results([{**ROW, "ours": 2.29}])), [""])
        self.assertEqual(self.flags(old, results([{**ROW, "ours": 2.31}])), ["WORSE"])
        self.assertEqual(self.flags(old, results([{**ROW, "ours": 2.31}]), own={"bits cow 128": 0.33}), [""])
        self.assertEqual(self.flags(old, results([{**ROW, "ours": 1.0}])), [""])
        self.assertEqual(self.flags(results([ROW], better="higher"), results([{**ROW, "ours": 1.5}])), ["WORSE"])

    def test_counts_must_be_equal(self):
        self.assertEqual(self.flags(results([ROW]), results([{**ROW, "occupied": 11}])), ["DIFFERENT"])
        self.assertEqual(self.flags(results([ROW], better="equal"), results([{**ROW, "ours": 1.0}])), ["DIFFERENT"])
        self.assertEqual(self.flags(results([ROW]), results([ROW], unit="us")), ["DIFFERENT"])

    def test_rows_of_one_file_alone(self):
        other = {**ROW, "N": 512}
        self.assertEqual(self.flags(results([ROW]), results([other])), ["MISSING", "new"])

    def test_the_exit_status(self):
        with tempfile.TemporaryDirectory() as folder:
            paths = [os.path.join(folder, name) for name in ("old.json", "new.json")]
            bench_file.write(paths[0], results([ROW]))
            bench_file.write(paths[1], results([{**ROW, "ours": 3.0}]))
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                self.assertEqual(compare_results.main([paths[0], paths[0]]), 0)
                self.assertEqual(compare_results.main(paths), 1)
                self.assertEqual(compare_results.main([*paths, "--row", "bits cow 128=0.6"]), 0)
                self.assertEqual(compare_results.main([*paths, "--row", "no such row=0.6"]), 2)
                self.assertEqual(compare_results.main([paths[0], __file__]), 2)


PROGRAM = """#!/usr/bin/env python3
import json, sys
assert sys.argv[1] == "voxelize" and "--json" in sys.argv
if {fails} and "--fill" in sys.argv:
    sys.exit("no such fill")
print(json.dumps({{"voxelize_cpu_ms_min": {ms}, "voxelize_cpu_ms": 9, "voxelize_ms": 5, "hash": "{hash}"}}))
"""


class Programs(unittest.TestCase):
    def test_ratios_of_programs_in_turns(self):
        with tempfile.TemporaryDirectory() as folder:
            for name, ms, digest, fails in (("ours", 2.0, "a", 0), ("same", 4.0, "a", 0), ("other", 1.0, "b", 1)):
                path = os.path.join(folder, name)
                with open(path, "w", encoding="utf-8") as file:
                    file.write(PROGRAM.format(ms=ms, hash=digest, fails=fails))
                os.chmod(path, 0o755)
            said = io.StringIO()
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
                code = compare_programs.main([
                    f"{folder}/ours", f"--old=A={folder}/same", f"--old=B={folder}/other", "--mesh=sphere=x.glb",
                    "--row=^(bits|flood fill) sphere 512$", "--rounds=2", "--machine=m", f"--out={folder}"])
            self.assertEqual(code, 1)
            self.assertIn("failed: flood fill sphere 512: B", said.getvalue())
            first, second = (bench_file.read(f"{folder}/cpu-beside-{name}.json")["rows"] for name in "AB")
            self.assertEqual([row["case"] for row in first], ["bits", "flood fill"])
            self.assertEqual((first[0]["ours"], first[0]["theirs"], first[0]["of_its_time"]), (2.0, 4.0, 0.5))
            self.assertEqual([(row["case"], row["of_its_time"], row["result"]) for row in second],
                             [("bits", 2.0, "other bytes")])


if __name__ == "__main__":
    unittest.main()
