"""Tests of the studies as developers start them: run by python_test, in a fresh environment with the wheel."""

import contextlib
import csv
import io
import json
import math
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import numpy as np

try:
    import matplotlib
except ImportError:
    print("skipped: matplotlib is not installed (Debian: python3-matplotlib), and the studies draw with it")
    raise SystemExit(0)

import pydimple

SOURCE = pathlib.Path(os.environ["DIMPLE_SOURCE"])
STUDIES = SOURCE / "tests/studies"
sys.path.insert(0, str(STUDIES))

import _study
import atlas
import chart
import converge

PROGRAM = os.environ["DIMPLE_PROGRAM"]


def dimple(folder, words):
    subprocess.run([PROGRAM, *words.split()], cwd=folder, check=True, capture_output=True)


class Study(unittest.TestCase):
    """A folder of its own, which is the current one."""

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(dir=".")).absolute()
        before = os.getcwd()
        os.chdir(self.folder)
        self.addCleanup(shutil.rmtree, self.folder)
        self.addCleanup(os.chdir, before)

    def block(self):
        dimple(self.folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3")

    def ran(self, module, words):
        """Exit code, stdout and stderr."""
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = module.main(words.split())
            except SystemExit as ended:  # argparse's
                code = ended.code
        return code, out.getvalue(), err.getvalue()

    def good(self, module, words):
        code, out, err = self.ran(module, words)
        self.assertEqual(code, 0, err)
        return out, err

    def refused(self, module, words, code, *parts):
        ended, _, err = self.ran(module, words)
        self.assertEqual(ended, code, f"{words}\n{err}")
        for part in parts:
            self.assertIn(part, err, words)

    def table(self, file):
        with open(file, newline="", encoding="utf-8") as opened:
            return list(csv.DictReader(opened))


class Common(unittest.TestCase):
    def test_an_option_is_known_by_its_key_its_flag_and_either_without_the_unit(self):
        for word in ("material.mu_Pa", "material.mu", "--mu", "mu"):
            self.assertEqual(_study.key_of(word), "material.mu_Pa", word)
        self.assertEqual(_study.key_of("--indent-at"), "boundary.indent_at")
        self.assertEqual(_study.key_of("load.rate"), "load.rate_mm_per_s")

    def test_the_arguments_of_a_case_are_what_differs_from_the_defaults(self):
        case = _study.Case("a.nrrd", {"material.nu": "0.3", "cloud.nodes": "300"}).having({"solver.frames": 4, "cloud.jitter": 0})
        self.assertEqual(case.arguments(), ["--set", "cloud.nodes=300", "--set", "material.nu=0.3", "--set", "solver.frames=4"])

    def test_forces_are_between_samples_and_as_many_as_these_reach(self):
        np.testing.assert_allclose(_study.forces_at([0.0, 1.0, 2.0], [0.0, 10.0, 30.0], [0.5, 1.5, 2.5]), [5.0, 20.0])


class Converge(Study):
    COMMAND = "block.nrrd -o out --sizes 300,600 --seeds 2 --depth 1mm --frames 2"

    def test_clouds_of_several_sizes_densities_and_seeds_are_compared(self):
        self.block()
        pathlib.Path("known.csv").write_text("indentation_mm,force_N\n0.5,0.0049\n1,0.0098\n")
        out, _ = self.good(converge, self.COMMAND + " --reference known.csv")
        self.assertIn("difference from the reference", out)
        rows = self.table("out/convergence.csv")
        self.assertEqual(list(rows[0]), list(self.table(SOURCE / "tests/verification/results/convergence_block.csv")[0]))
        self.assertEqual(len(rows), 2 * 2 * 2 * 2)  # sizes, densities, seeds, depths
        # Coarse discretisations against the verification block's reference, known to 1 %: hundreds of nodes are a few per cent off.
        for row in rows:
            known = float(row["reference_N"])
            self.assertAlmostEqual(float(row["force_N"]), known, delta=0.15 * known)
        for name in ("convergence.md", "convergence.png", "convergence.svg"):
            self.assertGreater(pathlib.Path("out", name).stat().st_size, 100, name)
        self.good(converge, self.COMMAND + " --reference known.csv -q")  # a second time

    def test_the_usual_density_is_that_of_a_plain_run(self):
        self.block()
        for scheme in ("converging", "horton2007"):
            case = _study.Case("block.nrrd", {"scheme.name": scheme, "cloud.nodes": "300", "accuracy.band": "off", "load.depth_mm": "1"})
            usual = case.run()
            given = case.having({"grid.ratio": converge._POINTS_PER_NODE[scheme]}).run()
            np.testing.assert_array_equal(usual.force_N, given.force_N)

    # A dynamic run has a sample for each hundredth of a second, not for each depth. At this low speed waves are small.
    def test_runs_in_time_are_compared_at_their_depths(self):
        self.block()
        self.good(converge, "block.nrrd -o out --sizes 300,600 --densities 1 --seeds 1 --depth 1mm --rate 2mm/s --frames 2 --scheme horton2007")
        rows = self.table("out/convergence.csv")
        self.assertEqual([row["indentation_mm"] for row in rows], ["0.5", "1", "0.5", "1"])
        for half, whole in (rows[:2], rows[2:]):
            force = float(whole["force_N"])
            self.assertAlmostEqual(float(half["force_N"]), 0.5 * force, delta=0.1 * force)

    def test_what_makes_no_comparison_is_refused_before_the_first_run(self):
        self.block()
        pathlib.Path("known.csv").write_text("indentation_mm,force_N\n0.3,0.005\n")
        pathlib.Path("words.csv").write_text("indentation_mm,force_N\n0.5,much\n")
        self.refused(converge, "block.nrrd -o out --sizes 300", 2, "at least two cloud sizes")
        self.refused(converge, "-o out", 2, "no label image")
        self.refused(converge, "block.nrrd", 2, "no folder for the results")
        self.refused(converge, "block.nrrd -o out --nu 0.7", 2, "nu=0.7 is not allowed")
        self.refused(converge, "block.nrrd -o out --nue 0.7", 2, "unrecognized arguments: --nue")
        self.refused(converge, "block.nrrd -o out --accuracy 5%", 2, "a study takes no accuracy")
        self.refused(converge, self.COMMAND + " --reference known.csv", 3, "no force at 0.5 mm")
        self.refused(converge, self.COMMAND + " --reference words.csv", 3, "words.csv")
        self.refused(converge, "nowhere.nrrd -o out", 3, "nowhere.nrrd")
        self.assertFalse(os.path.exists("out"))

    def test_a_folder_of_other_files_or_none_is_refused(self):
        self.block()
        pathlib.Path("others").mkdir()
        pathlib.Path("others/letter.txt").write_text("dear")
        self.refused(converge, "block.nrrd -o others", 6, "not results of")
        self.refused(converge, "block.nrrd -o block.nrrd/out", 6, "cannot be made")


# ----------------------------------------------------------------------------------------------- Ctrl-C, and a full disk


def cpu_s(pid):
    """CPU seconds that a process and its children have used so far, by proc(5); 0 of one that has ended."""
    try:
        fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        children = [child for part in pathlib.Path(f"/proc/{pid}/task").iterdir() for child in (part / "children").read_text().split()]
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK") + sum(map(cpu_s, children))


def interrupted(process):
    """Output after a Ctrl-C, and the CPU seconds used: the machine may be busy with other things."""
    before = cpu_s(process.pid)
    process.send_signal(signal.SIGINT)
    said = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return said, used.ru_utime + used.ru_stime - before


class Stop(Study):
    def stopped(self, words, after_s):
        """Exit code and output after a Ctrl-C at that CPU time; the answer must come within 2 s of a free machine."""
        script, *words = words.split()
        process = subprocess.Popen([sys.executable, str(STUDIES / script), *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        with process:
            while cpu_s(process.pid) < after_s and not os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
                time.sleep(0.02)
            said, used_s = interrupted(process)
        self.assertNotIn("Traceback", said)
        self.assertLess(used_s, 2.0 * os.cpu_count(), said)
        return process.returncode, said

    def test_every_study_answers_within_two_seconds(self):
        self.block()
        for words in (
            "converge.py block.nrrd -o out/converge --sizes 2000,4000,8000",
            "chart.py -o out/chart --only a --nodes 1000,2000",
            "atlas.py -o out/atlas --map depth-nu --finest 500 --limit 20",
        ):
            code, said = self.stopped(words, 3.0)
            self.assertEqual(code, 130, f"{words}: {said}")
            self.assertIn("interrupted", said)
            self.assertEqual([p.name for p in pathlib.Path("out").rglob(".*")], [], "parts of files")

    # The interrupt is within one run: a part of a curve must not become numbers of the whole.
    def test_a_study_amid_a_run_keeps_the_runs_before_it(self):
        self.block()
        kept = []
        for after in (1.5, 3.0, 6.0):
            shutil.rmtree("out", ignore_errors=True)
            code, said = self.stopped("converge.py block.nrrd -o out --sizes 300,500,700,900,1100,2000,3000 --frames 4", after)
            self.assertEqual(code, 130, said)
            rows = len(self.table("out/convergence.csv")) if os.path.exists("out/convergence.csv") else 0
            self.assertEqual(rows % 4, 0)  # frames of a run
            if rows:
                self.assertIn(f"convergence.csv has the {rows // 4} runs until then", said)
            kept.append(rows)
        self.assertGreater(max(kept), 0)

    def test_a_full_disk_leaves_whole_files_or_none(self):
        self.block()
        for size in (0, 100, 2000, 20000):
            shutil.rmtree("out", ignore_errors=True)
            limited = "import resource, runpy, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2); "
            limited += f"sys.path.insert(0, {str(STUDIES)!r}); runpy.run_module('converge', run_name='__main__')"
            words = f"block.nrrd -o out --sizes 300,400 --densities 1 --seeds 1 --frames 2 --depth 1mm -q"
            ended = subprocess.run([sys.executable, "-c", limited, str(size), *words.split()], capture_output=True, text=True, check=False)
            self.assertEqual(ended.returncode, 6, ended.stderr)
            self.assertIn("cannot be written", ended.stderr)
            for file in pathlib.Path("out").iterdir():
                self.assertIn(file.name, ("convergence.csv", "convergence.md", "convergence.png"))
                self.assertEqual(file.read_bytes()[-1:], b"\n" if file.suffix != ".png" else b"\x82", file)


# ------------------------------------------------------------------------------------------------------------- the atlas

CIRCLE_MM = 5.0


def stiffening(factor=1.0, nodes=1000):
    """A curve that stiffens, F = d^1.3, in ten frames."""
    return atlas.Run(frames=[atlas.Frame(float(k), factor * 0.01 * k**1.3) for k in range(1, 11)], nodes=nodes)


class Verdict(unittest.TestCase):
    """Tests of a map's verdicts, on synthetic numbers."""

    def code(self, run, last=10):
        return atlas.judge(run, [stiffening(1.0, 4000)], last, True, CIRCLE_MM).code

    def test_a_cell_survives_within_five_per_cent_of_the_finest(self):
        v = atlas.judge(stiffening(1.04), [stiffening(1.0, 4000)], 10, True, CIRCLE_MM)
        self.assertEqual((v.code, v.reference_nodes), ("ok", 4000))
        self.assertAlmostEqual(v.error, 0.04, places=12)
        self.assertEqual(self.code(stiffening(1.06)), "inaccurate")
        self.assertEqual(self.code(stiffening(0.94)), "inaccurate")

    def test_the_largest_error_of_all_depths_counts_unless_each_is_a_cell_of_its_own(self):
        run = stiffening()
        for k, frame in enumerate(run.frames):  # too stiff half-way, right in the end
            frame.force_N *= 1 + 0.06 * math.sin(math.pi * (k + 1) / 10)
        self.assertEqual(atlas.judge(run, [stiffening()], 10, True, CIRCLE_MM).code, "ok")
        self.assertEqual(atlas.judge(run, [stiffening()], 10, False, CIRCLE_MM).code, "inaccurate")

    def test_a_bend_of_the_curve_is_a_kink_and_stiffening_is_none(self):
        self.assertEqual(self.code(stiffening()), "ok")
        bent = stiffening()
        for k in range(7, 10):  # no stiffer from there on, at half the slope
            bent.frames[k].force_N = bent.frames[k - 1].force_N + 0.01
        self.assertEqual(self.code(bent, 7), "ok", "before the bend")
        self.assertEqual(self.code(bent, 8), "kinked")
        self.assertEqual(self.code(bent, 10), "kinked", "a curve with a bend stays one")

    def test_work_that_is_not_accounted_for_is_a_fault(self):
        run = stiffening()
        for frame in run.frames[5:]:
            frame.energy_error = 0.03
        self.assertEqual([self.code(run, last) for last in (5, 6, 10)], ["ok", "energy", "energy"])

    def test_a_few_inverted_points_at_the_rim_are_a_note_and_many_are_a_fault(self):
        run = stiffening()
        half_ball = 2 / 3 * math.pi * CIRCLE_MM**3
        for frame in run.frames:
            frame.J_min, frame.inverted, frame.inverted_mm3 = -0.1, 12, 0.009 * half_ball
        self.assertEqual(self.code(run), "ok-rim")
        self.assertTrue(atlas.survived("ok-rim"))
        run.frames[-1].inverted_mm3 = 0.011 * half_ball
        self.assertEqual(self.code(run), "inverted")
        self.assertFalse(atlas.survived("inverted"))

    def test_a_number_that_is_none_is_a_fault(self):
        run = stiffening()
        run.frames[3].force_N = math.nan
        self.assertEqual(self.code(run), "non-finite")
        run = stiffening()
        run.frames[3].J_min = math.inf
        self.assertEqual(self.code(run), "non-finite")

    def test_a_run_that_ended_says_why_only_beyond_the_depth_that_it_reached(self):
        run = stiffening()
        del run.frames[6:]
        run.ended = "no-equilibrium"
        self.assertEqual([self.code(run, last) for last in (6, 7)], ["ok", "no-equilibrium"])

    def test_a_finest_run_that_is_not_stable_itself_is_no_reference(self):
        broken = stiffening(1.5, 4000)
        for frame in broken.frames[7:]:
            frame.energy_error = 0.5
        self.assertEqual(atlas.judge(stiffening(), [broken], 7, True, CIRCLE_MM).code, "inaccurate", "up to there it serves")
        self.assertEqual(atlas.judge(stiffening(), [broken], 8, True, CIRCLE_MM).code, "unchecked")
        then = atlas.judge(stiffening(), [broken, stiffening(1.0, 2000)], 8, True, CIRCLE_MM)
        self.assertEqual((then.code, then.reference_nodes), ("ok", 2000))


class Maps(unittest.TestCase):
    def test_an_axis_is_an_option_with_its_unit_and_values(self):
        axis = atlas.axis_of("material.mu=100,0.2kPa", "--x")
        self.assertEqual((axis.key, axis.values), ("material.mu_Pa", ["100", "0.2kPa"]))
        self.assertTrue(atlas.is_physical(axis.key))
        self.assertFalse(atlas.is_physical("cloud.nodes"))

    def test_a_map_of_a_tool_that_touches_asks_the_scheme_of_2007_for_nothing(self):
        by_name = {of.name: of for of in atlas.MAPS}
        self.assertEqual(by_name["tool-depth"].schemes(atlas.SCHEMES, {}), ["converging"])
        self.assertEqual(by_name["depth-nu"].schemes(atlas.SCHEMES, {}), atlas.SCHEMES)
        self.assertEqual(by_name["depth-nu"].schemes(atlas.SCHEMES, {"tool.shape": "sphere:5mm"}), ["converging"])

    def test_an_axis_is_refused_where_it_makes_no_map(self):
        wrong = {
            "material.nu": "is not key=value",
            "material.nv=0.3,0.4": "did you mean 'nu'",
            "material.nu=0.3,0.7": "nu=0.7 is not allowed",
            "material.nu=": "is not allowed",
            "material.nu=0.3": "has 1 value",
            "material.nu=0.3,0.3": "given twice",
            "load.depth=1mm,2mm,4mm": "the depths are not even steps",
        }
        for text, words in wrong.items():
            with self.assertRaises((pydimple.UsageError, _study.Refused), msg=text) as caught:
                atlas.axis_of(text, "--x")
            self.assertIn(words, str(caught.exception))

    def test_names_are_their_own_and_values_are_taken(self):
        names = [of.name for of in atlas.MAPS]
        for of in atlas.MAPS:
            atlas.check_axis(of.x, "--x")
            atlas.check_axis(of.y, "--y")
            _study.Case("", of.settings).values()
        self.assertGreaterEqual(len(names), 6)
        self.assertEqual(len(set(names)), len(names))

    def test_the_maps_are_those_whose_data_is_kept(self):
        for of in atlas.MAPS:
            with open(SOURCE / f"tests/verification/results/stress_{of.name}.csv", encoding="utf-8") as opened:
                rows = list(csv.DictReader(opened))
            self.assertEqual({row[of.x.key] for row in rows}, set(of.x.values), of.name)
            self.assertEqual({row[of.y.key] for row in rows}, set(of.y.values), of.name)

    def test_the_finest_run_is_the_same_case_computed_as_usual(self):
        case = _study.Case("", {
            "material.nu": "0.3", "load.depth_mm": "3", "cloud.jitter": "0.5", "support.radius_factor": "3",
            "scheme.name": "horton2007", "solver.frames": "6",
        })  # fmt: skip
        values, usual = atlas.finest_of(case, 4000).values(), _study.Case().values()
        for key, expected in {"material.nu": 0.3, "load.depth_mm": 3.0, "solver.frames": 6, "cloud.nodes": 4000}.items():
            self.assertEqual(values[key], expected, key)
        for key in ("cloud.jitter", "support.radius_factor", "scheme.name"):
            self.assertEqual(values[key], usual[key], key)


class Atlas(Study):
    SMALL = (
        "-o out --x material.nu=0.3,0.499 --y cloud.nodes=150,200 --finest 400,300 --schemes converging --set load.depth=1mm "
        "--set solver.frames=2"
    )

    def counted(self, out):
        """Number of runs, and of those computed now."""
        return tuple(int(n) for n in re.search(r"(\d+) runs, (\d+) of them now", out).groups())

    def test_a_map_of_a_tool_is_refused_for_the_scheme_of_2007_alone(self):
        self.refused(atlas, "-o out --map tool-depth --schemes horton2007", 2, "knows no contact", "--schemes")

    def test_a_map_of_two_options_has_a_code_for_every_cell(self):
        out, _ = self.good(atlas, "-o out --x material.nu=0.3,0.499 --y load.depth=1mm,2mm --finest 400,300 --set cloud.nodes=200")
        self.assertIn("survive", out)
        rows = self.table("out/stress_own.csv")
        kept = list(self.table(SOURCE / "tests/verification/results/stress_depth-nu.csv")[0])
        self.assertEqual(list(rows[0]), kept)
        self.assertEqual(len(rows), 2 * 2 * 2)
        first, last = rows[0], rows[-1]
        self.assertEqual((first["scheme"], first["material.nu"], first["load.depth_mm"]), ("converging", "0.3", "1mm"))
        self.assertEqual((last["scheme"], last["material.nu"], last["load.depth_mm"]), ("horton2007", "0.499", "2mm"))
        self.assertIn("--set cloud.nodes=200", first["run"])
        svg = pathlib.Path("out/stress_own.svg").read_text()
        for words in ("material.nu and load.depth_mm: converging", "horton2007", "0.499", "2mm", "cells"):
            self.assertIn(words, svg)
        self.assertGreater(pathlib.Path("out/stress_own.png").stat().st_size, 1000)
        self.assertIn("own,converging,4,", pathlib.Path("out/stress.csv").read_text())

    def test_a_cell_holds_what_the_run_that_it_names_says(self):
        self.good(atlas, self.SMALL)
        row = self.table("out/stress_own.csv")[-1]
        dimple(self.folder, row["run"].replace("dimple ", "", 1).replace(" block_", " out/block_").replace("-o out", "-o again"))
        force = self.table("again/force.csv")[-1]
        self.assertEqual(f"{float(force['force_N']):.6g}", row["force_N"])
        summary = json.loads(pathlib.Path("again/summary.json").read_text())
        self.assertEqual(str(summary["counts"]["integration_points"]), row["points"])
        self.assertAlmostEqual(summary["J_min"], float(row["J_min"]), delta=1e-3)
        self.assertAlmostEqual(100 * summary["energy_error"], float(row["energy_error_percent"]), delta=1e-3)

    def test_a_second_call_runs_nothing_that_is_there(self):
        first, _ = self.good(atlas, self.SMALL)
        runs, now = self.counted(first)
        self.assertEqual(runs, now)
        csv_text = pathlib.Path("out/stress_own.csv").read_text()
        self.assertEqual(self.counted(self.good(atlas, self.SMALL)[0]), (runs, 0))
        self.assertEqual(pathlib.Path("out/stress_own.csv").read_text(), csv_text)
        # One more column requires its runs only.
        wider = self.counted(self.good(atlas, self.SMALL.replace("0.3,0.499", "0.3,0.45,0.499"))[0])
        self.assertEqual(wider[1], wider[0] - runs)
        # With other settings the present files belong to others.
        others = self.counted(self.good(atlas, self.SMALL + " --set material.mu=300")[0])
        self.assertEqual(others[0], others[1])

    def test_the_bytes_are_the_same_whatever_the_threads_and_interruptions(self):
        self.good(atlas, self.SMALL + " --threads 1")
        before = {name: pathlib.Path("out", name).read_bytes() for name in ("stress_own.csv", "stress_own.svg", "stress_own.png")}
        os.rename("out", "first")
        command = [sys.executable, str(STUDIES / "atlas.py"), *self.SMALL.split(), "--threads", "2"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
            line = process.stderr.readline()
            self.assertIn("finished", line)
            said, used_s = interrupted(process)
        self.assertLess(used_s, 5.0 * os.cpu_count())
        self.assertIn(process.returncode, (130, 0), said)
        self.good(atlas, self.SMALL + " --threads 2")
        for name, expected in before.items():
            self.assertEqual(pathlib.Path("out", name).read_bytes(), expected, name)

    def test_scenes_of_an_image_are_swept(self):
        dimple(self.folder, "phantom brain.nrrd --spacing 3")
        words = "--x cloud.jitter=0,0.5 --y cloud.nodes=200,300 --finest 500 --schemes converging --set load.depth=1mm"
        self.good(atlas, f"brain.nrrd -o out {words} --set solver.frames=2")
        self.assertIn("dimple run brain.nrrd -o out --set", self.table("out/stress_own.csv")[0]["run"])

    def test_a_run_without_time_or_without_a_model_is_a_cell_with_its_code(self):
        self.assertIn("0 of   4 survive: time-out 4", self.good(atlas, self.SMALL + " --limit 0.001")[0])
        # With more time these cells run again.
        self.assertNotIn("time-out", self.good(atlas, self.SMALL)[0])
        # A patch larger than the block has no model.
        self.good(
            atlas,
            "-o none --x boundary.indenter_diameter=10,90 --y cloud.nodes=150,200 --schemes converging --finest 300 "
            "--set load.depth=1mm --set solver.frames=2",
        )
        self.assertIn("converging,90,150,no-model,", pathlib.Path("none/stress_own.csv").read_text())

    def test_deep_below_a_sharp_rim_points_turn_inside_out(self):
        self.good(
            atlas, "-o out --x material.nu=0.3,0.499 --y load.depth=10.5mm,21mm --finest 600 --schemes converging --set cloud.nodes=300"
        )
        text = pathlib.Path("out/stress_own.csv").read_text()
        self.assertIn("converging,0.3,21mm,inverted,", text)
        self.assertNotIn("converging,0.3,10.5mm,inverted,", text)

    def test_a_time_step_above_the_stable_one_is_taken_back_and_its_cell_is_that_of_the_shorter_step(self):
        self.good(
            atlas,
            "-o out --x solver.safety=0.9,2 --y cloud.nodes=150,200 --finest 300 --schemes horton2007 --set load.depth=0.2mm "
            "--set solver.frames=2",
        )
        rows = {row["solver.safety"]: row for row in self.table("out/stress_own.csv") if row["cloud.nodes"] == "200"}
        self.assertEqual(rows["2"]["code"], rows["0.9"]["code"])
        force = float(rows["0.9"]["force_N"])
        self.assertAlmostEqual(float(rows["2"]["force_N"]), force, delta=2e-3 * force)
        self.assertEqual((rows["0.9"]["retries"], rows["2"]["retries"]), ("0", "1"))

    def test_what_makes_no_map_is_refused_before_the_first_run(self):
        self.block()
        axes = " --x material.nu=0.3,0.4 --y cloud.nodes=200,300"
        wrong = [
            ("", 2, "no folder for the results"),
            ("-o out --map depht-nu", 2, "'depht-nu' is not known"),
            ("-o out --x material.nu=0.3,0.4", 2, "a map of one side"),
            ("-o out --x material.nu=0.3,0.4 --y material.nu=0.3,0.4", 2, "both axes are material.nu"),
            ("-o out --x material.nu=0.3,0.8 --y cloud.nodes=200,300", 2, "nu=0.8 is not allowed"),
            ("-o out --map depth-nu" + axes, 2, "both a map's name and axes"),
            ("block.nrrd -o out", 2, "an image was given, but no axes"),
            ("block.nrrd -o out --x phantom.height_mm=5,10 --y cloud.nodes=200,300", 2, "the height of an image cannot be swept"),
            ("gone.nrrd -o out" + axes, 3, "gone.nrrd"),
            ("-o out --schemes horton" + axes, 2, "'horton' is not known"),
            ("-o out --finest 50" + axes, 2, "50 nodes are too few"),
            ("-o out --limit 0" + axes, 2, "--limit"),
            ("-o ." + axes, 6, "not results of"),
        ]
        for words, code, said in wrong:
            self.refused(atlas, words, code, said)
            self.assertFalse(os.path.exists("out"), words)

    def test_what_a_run_refuses_is_said_once_in_its_words(self):
        words = "-o out --x material.nu=0.3,0.4 --y cloud.nodes=200,300 --finest 300 --set image.label=7"
        self.refused(atlas, words, 3, "no voxel has label 7", "why:", "try:")

    def test_the_maps_are_listed(self):
        out, _ = self.good(atlas, "--list")
        for of in atlas.MAPS:
            self.assertIn(of.name, out)


# ------------------------------------------------------------------------------------------------------------- the chart


class Front(unittest.TestCase):
    """Tests of the Pareto front, and of the references of scenes."""

    def test_the_front_holds_what_no_other_beats(self):
        nan = math.nan
        self.assertEqual(chart.pareto_front([3, 1, 2, 4, 5], [1, 5, 6, 1, 0.5]), [1, 0, 4])
        self.assertEqual(chart.pareto_front([1, 1, 1], [2, 1, 1]), [1, 2], "equals stay")
        self.assertEqual(chart.pareto_front([nan, 2, 3], [1, nan, 4]), [2])
        self.assertEqual(chart.pareto_front([], []), [])

    def test_the_scenes_are_those_of_the_reference_files(self):
        for name, file in (("a", "block.csv"), ("b", "cut_ellipsoid.csv")):
            with open(SOURCE / "tests/verification/reference" / file, encoding="utf-8") as opened:
                rows = list(csv.DictReader(opened))
            self.assertEqual([float(row["indentation_mm"]) for row in rows], [1, 2, 3, 4, 5, 6, 7, 8])
            self.assertEqual([float(row["force_N"]) for row in rows], chart.SCENES[name]["force_N"])
            self.assertEqual([float(row["uncertainty_percent"]) for row in rows], chart.SCENES[name]["known_to_percent"])


class Chart(Study):
    SMALL = "--schemes converging --time quasi-static"

    def test_a_small_one_of_an_image_and_a_scene(self):
        dimple(self.folder, "phantom brain.nrrd --spacing 3")
        words = f"brain.nrrd -o out --only b,image --nodes 300,400 --goals none {self.SMALL}"
        _, err = self.good(chart, words)
        self.assertIn("error", err)
        text = pathlib.Path("out/chart.csv").read_text()
        self.assertIn("b,dimple,converging,quasi-static,300,", text)
        self.assertIn("difference from 400 nodes", text)
        self.assertNotRegex(text, r'image,[^\n]*,1,"difference', "on a front without a reference")
        rows = self.table("out/chart.csv")
        self.assertEqual(list(rows[0]), list(self.table(SOURCE / "tests/bench/results/chart.csv")[0]))
        svg = pathlib.Path("out/chart.svg").read_text()
        for part in (
            "converging 300", "real time, 8 s", "Pareto front", "as reported", "[s]", "[%]",
            "difference from our own finest run, 400 nodes", "That run is no reference",
        ):  # fmt: skip
            self.assertIn(part, svg)
        self.assertGreater(pathlib.Path("out/chart.png").stat().st_size, 1000)
        self.good(chart, words + " -q")  # a second time

    def test_an_image_is_compared_with_its_own_reference_to_the_depths_that_it_has(self):
        self.block()
        pathlib.Path("known.csv").write_text("indentation_mm,force_N\n1,0.00975\n2,0.0193\n3,0.0288\n4,0.0381\n")
        words = f"block.nrrd -o out --only image --nodes 400 --goals 10% {self.SMALL}"
        self.good(chart, words + " --reference known.csv")
        text = pathlib.Path("out/chart.csv").read_text()
        self.assertRegex(text, r'image,dimple,converging,quasi-static,400,[^\n]*,1,0,,0,"known.csv","ok",0.0[^\n]*,,,,\n')
        self.assertRegex(text, r'image,dimple,accuracy 10%,quasi-static,[0-9]+,[^\n]*,0,0.0[0-9]+,1,"known.csv","ok"')
        svg = pathlib.Path("out/chart.svg").read_text()
        for part in (
            "error against wall time", "against known.csv", "1, 2, ... 4 mm", "real time, 4 s", "accuracy 10%",
            "stated error against wall time",
        ):  # fmt: skip
            self.assertIn(part, svg)
        pathlib.Path("half.csv").write_text("indentation_mm,force_N\n0.5,0.005\n")
        self.refused(chart, words + " --reference half.csv", 3, "no force at 1 mm")

    def test_what_makes_no_chart_is_refused_before_the_first_run(self):
        wrong = {
            "--only a,c": "'c' is not known",
            "--only image": "no label image was given",
            "--reference known.csv": "a reference was given, but no label image",
            "--nodes 50": "50 nodes are too few",
            "--goals 5%,much": "accuracy.goal = much is not allowed",
            "--time slow": "'slow' is not known",
        }
        for words, said in wrong.items():
            self.refused(chart, "-o out " + words, 2, said)
            self.assertFalse(os.path.exists("out"), words)
        self.refused(chart, "gone.nrrd -o out", 3, "gone.nrrd")
        self.assertFalse(os.path.exists("out"))


if __name__ == "__main__":
    unittest.main(verbosity=2)
