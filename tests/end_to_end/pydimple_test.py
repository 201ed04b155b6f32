"""The Python module as its users have it: run by python_test in a fresh virtual environment with its wheel."""

import ast
import gc
import inspect
import json
import logging
import os
import pathlib
import pickle
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import unittest

import numpy as np

import pydimple

SOURCE = pathlib.Path(os.environ["DIMPLE_SOURCE"])
PROGRAM = os.environ["DIMPLE_PROGRAM"]
SAMPLE = SOURCE / "sample_data" / "block_3mm.nrrd"
TWO_LABELS = SOURCE / "sample_data" / "two_labels_3mm.nii.gz"
FAST = {"nodes": 300, "depth_mm": 0.5, "frames": 2}


def half_ellipsoid():
    """Labels 0 and 1, of no symmetry along any axis, and their affine to LPS mm."""
    i, j, k = np.indices((24, 19, 11))
    labels = (((i - 11.5) / 9) ** 2 + ((j - 9.5) / 7) ** 2 + ((k - 1) / 7) ** 2 < 1) & (k >= 1) & (i + 2 * j < 45)
    return labels.astype(np.uint8), np.array([[3.0, 0, 0, -20], [0, 3.0, 0, 10], [0, 0, 3.0, 7], [0, 0, 0, 1]])


def write_nrrd(file, labels, to_lps):
    columns = " ".join("({:.17g},{:.17g},{:.17g})".format(*to_lps[:3, a]) for a in range(3))
    header = (
        "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nencoding: raw\nsizes: {} {} {}\n"
        "space directions: {}\nspace origin: ({:.17g},{:.17g},{:.17g})\n\n"
    ).format(*labels.shape, columns, *to_lps[:3, 3])
    file.write_bytes(header.encode() + labels.astype(np.uint8).tobytes(order="F"))


class InAFolder(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(dir="."))
        self.addCleanup(shutil.rmtree, self.folder)

    def raised(self, kind, *arguments, **keywords):
        """The error that a call ends with, whose five parts are all there."""
        call, *rest = arguments
        with self.assertRaises(kind) as caught:
            call(*rest, **keywords)
        error = caught.exception
        self.assertIs(type(error), kind)
        for part in (error.fact, error.where, error.why, error.remedy, error.code):
            self.assertTrue(part, f"a part is missing of: {error}")
        return error


class Images(InAFolder):
    def test_an_array_of_any_type_and_order_gives_the_model_of_its_file(self):
        labels, to_lps = half_ellipsoid()
        file = self.folder / "body.nrrd"
        write_nrrd(file, labels, to_lps)
        expected = pydimple.build_model(file, nodes=300)
        self.assertGreater(len(expected.positions_m), 250)
        types = ["?", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", ">i2"]
        for number, kind in enumerate(types):
            array = np.array(labels.astype(kind), order="CF"[number % 2])
            model = pydimple.build_model(array, affine=to_lps, space="LPS", nodes=300)
            np.testing.assert_array_equal(model.positions_m, expected.positions_m, err_msg=kind)
        strided = np.repeat(labels, 2, axis=1)[:, ::2]
        model = pydimple.build_model(strided, affine=to_lps, space="LPS", nodes=300)
        np.testing.assert_array_equal(model.points_m, expected.points_m)

    def test_arrays_in_either_order_are_read_where_they_are(self):
        for order in "CF":
            array = np.zeros((4, 5, 6), np.int16, order)
            self.assertTrue(np.shares_memory(pydimple._array("run", array), array))
            mask = array > 0
            self.assertTrue(np.shares_memory(pydimple._array("run", mask), mask))

    def test_the_space_of_the_affine_decides_which_way_is_left(self):
        labels, to_lps = half_ellipsoid()
        in_ras = np.diag([-1, -1, 1, 1]) @ to_lps
        lps = pydimple.build_model(labels, affine=to_lps, space="LPS", nodes=300)
        ras = pydimple.build_model(labels, affine=in_ras, space="RAS", nodes=300)
        np.testing.assert_array_equal(ras.positions_m, lps.positions_m)
        wrong = pydimple.build_model(labels, affine=to_lps, space="RAS", nodes=300)
        self.assertGreater(np.abs(wrong.positions_m.mean(0) - lps.positions_m.mean(0)).max(), 0.01)

    def test_a_voxel_lies_where_the_affine_says(self):
        labels, to_lps = half_ellipsoid()
        model = pydimple.build_model(labels, affine=to_lps, space="LPS", nodes=300)
        centre_mm = to_lps[:3, :3] @ np.argwhere(labels).mean(0) + to_lps[:3, 3]
        by_volume_mm = 1e3 * (model.points_m * model.volume_m3[:, None]).sum(0) / model.volume_m3.sum()
        np.testing.assert_allclose(by_volume_mm, centre_mm, atol=0.3)

    def test_nibabel_images_come_in_as_their_files_do(self):
        try:
            import nibabel
        except ImportError:
            self.skipTest("nibabel is not installed (Debian: python3-nibabel)")
        image = nibabel.load(TWO_LABELS)
        by_file = pydimple.build_model(TWO_LABELS, nodes=300, label=2)
        for data in (np.asarray(image.dataobj), image.get_fdata()):
            model = pydimple.build_model(data, affine=image.affine, space="RAS", nodes=300, label=2)
            np.testing.assert_array_equal(model.positions_m, by_file.positions_m)

    def test_what_is_no_segmentation_or_lies_nowhere_is_refused(self):
        labels, to_lps = half_ellipsoid()
        run, here = pydimple.run, {"affine": to_lps, "space": "LPS"}
        usage, wrong = pydimple.UsageError, pydimple.InputError
        self.assertIn("both", self.raised(usage, run, labels).remedy)
        self.raised(usage, run, labels, affine=to_lps)
        self.raised(usage, run, labels, space="LPS")
        self.assertIn("RAS", self.raised(usage, run, labels, affine=to_lps, space="ras").remedy)
        self.raised(usage, run, SAMPLE, **here)
        self.raised(usage, run, labels, affine=to_lps[:3], space="LPS")
        self.raised(usage, run, labels, affine=to_lps.T, space="LPS")
        self.raised(usage, run, labels[0], **here)
        self.raised(usage, run, labels.astype(complex), **here)
        self.raised(usage, run, None, **here)
        self.raised(wrong, run, labels, affine=0 * to_lps + np.diag([0, 0, 0, 1.0]), space="LPS")
        nowhere = to_lps.copy()
        nowhere[0, 3] = np.nan
        self.raised(wrong, run, labels, affine=nowhere, space="LPS")
        self.raised(wrong, run, 0 * labels, **here)
        self.raised(wrong, run, labels[:, :, :1], **here)
        self.raised(wrong, run, labels[:0], **here)
        self.assertIn("(3, 4, 5)", self.raised(wrong, run, self.with_fault(labels, -1), **here).where)
        self.raised(wrong, run, self.with_fault(labels.astype(float), 0.5), **here)
        self.raised(wrong, run, self.with_fault(labels.astype(float), np.nan), **here)
        self.raised(wrong, run, self.folder / "none.nrrd")

    def with_fault(self, labels, value):
        labels = labels.astype(np.int16 if value == -1 else float)
        labels[3, 4, 5] = value
        return labels


class Arrays(InAFolder):
    def test_views_are_the_librarys_memory_and_outlive_all_else(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        result = pydimple.solve(model, depth_mm=0.5, frames=2)
        for owner, names in (
            (model, "positions_m points_m volume_m3 label base circle circle_centre_m push surface_mm triangles"),
            (result, "depth_m force_N base_force_N time_s displacement_m frame_depth_m frame_time_s"),
        ):
            for name in names.split():
                array, again = getattr(owner, name), getattr(owner, name)
                self.assertIs(array.base, owner, name)
                self.assertFalse(array.flags.owndata or array.flags.writeable, name)
                self.assertEqual(array.__array_interface__["data"], again.__array_interface__["data"], name)
        self.assertEqual(result.force_N.strides, result.depth_m.strides)  # columns of one table
        force, copied = result.force_N, result.force_N.copy()
        nodes, nodes_copied = model.positions_m, model.positions_m.copy()
        del model, result, array, again, owner
        gc.collect()
        np.testing.assert_array_equal(force, copied)
        np.testing.assert_array_equal(nodes, nodes_copied)

    def test_shapes_and_units_are_as_documented(self):
        result = pydimple.run(SAMPLE, **FAST)
        model, frames = result.model, 1 + FAST["frames"]
        n = len(model.positions_m)
        self.assertEqual(result.displacement_m.shape, (frames, n, 3))
        np.testing.assert_allclose(result.frame_depth_m, [0, 0.25e-3, 0.5e-3], atol=1e-12)
        np.testing.assert_array_equal(result.displacement_m[0], np.zeros((n, 3)))
        moved = result.displacement_m[-1][model.circle] @ model.push
        np.testing.assert_allclose(moved, 0.5e-3, atol=1e-9)
        np.testing.assert_allclose(result.displacement_m[-1][model.base], 0, atol=1e-12)
        self.assertAlmostEqual(model.volume_m3.sum(), 60e-3 * 60e-3 * 30e-3, delta=2e-6)
        self.assertAlmostEqual(model.circle_radius_m, 5e-3)
        at_surface = model.at_surface(result.displacement_m[-1])
        self.assertEqual(at_surface.shape, model.surface_mm.shape)
        self.assertEqual(model.at_surface(np.ones((n, 1))).shape, (len(model.surface_mm), 1))
        self.assertGreater((at_surface @ model.push).max(), 0.45e-3)
        self.assertLess(model.triangles.max(), len(model.surface_mm))
        self.raised(pydimple.UsageError, model.at_surface, np.ones((n + 1, 3)))

    def test_a_session_hands_over_arrays_of_their_own(self):
        session = pydimple.Session(pydimple.build_model(SAMPLE, nodes=300), mu_Pa=210)
        session.equilibrate(depth_mm=0.3)
        for name in ("positions_m", "displacement_m", "forces_N"):
            array = getattr(session, name)
            self.assertEqual(array.shape[1], 3)
            self.assertEqual(type(array.base).__name__, "PyCapsule")  # moved, not copied
            self.assertTrue(array.flags.writeable)
            array[:] = 0
            self.assertTrue(getattr(session, name).any())


class Program(InAFolder):
    def test_a_run_gives_the_bits_of_the_command_line(self):
        common = ["--nodes", "1000", "--depth", "1mm", "--frames", "4", "--mu", "0.3kPa", "--indent-at", "0,0,top"]
        by_program, by_module = self.folder / "program", self.folder / "module"
        subprocess.run([PROGRAM, "run", SAMPLE, "-o", by_program, "--quiet", *common], check=True, stdout=subprocess.DEVNULL)
        options = {"nodes": 1000, "depth_mm": 1, "frames": 4, "mu_Pa": 300.0, "indent_at": "0,0,top"}
        result = pydimple.run(SAMPLE, out=by_module, **options)
        files = sorted(file.relative_to(by_program) for file in by_program.rglob("*") if file.is_file())
        self.assertEqual(files, sorted(file.relative_to(by_module) for file in by_module.rglob("*") if file.is_file()))
        # Times and where options were given differ, and the picture and the page show them.
        for file in files:
            if file.name not in ("summary.json", "config.resolved.toml", "overview.png", "report.html"):
                self.assertEqual((by_program / file).read_bytes(), (by_module / file).read_bytes(), file)
        summary = json.loads((by_program / "summary.json").read_text())
        in_memory = pydimple.run(SAMPLE, **options)
        for ours in (result, in_memory):
            self.assertEqual(ours.summary["force_N"], summary["force_N"])
            self.assertEqual(ours.force_N[-1], summary["force_N"])
            self.assertEqual(ours.band_low_N[-1], summary["band"]["low_N"])
            self.assertEqual(ours.band_high_N[-1], summary["band"]["high_N"])
            self.assertEqual(ours.band_unknown, "")
            parts = {"parts_wall_s"}  # of the command, which writes files too
            self.assertEqual(set(ours.summary) - parts, set(summary) - parts)
            self.assertEqual(ours.summary["image_sha256"], summary["image_sha256"])
        np.testing.assert_array_equal(in_memory.displacement_m, result.displacement_m)

    def test_its_two_halves_give_the_same_force(self):
        whole = pydimple.run(SAMPLE, mu_Pa=321.1, **FAST)
        model = pydimple.build_model(SAMPLE, nodes=300)
        for of in (model, whole.model):
            solved = pydimple.solve(of, mu_Pa=321.1, depth_mm=0.5, frames=2)
            np.testing.assert_array_equal(solved.force_N, whole.force_N)
            self.assertIsNone(solved.band_low_N)
            self.assertIn("1000 nodes", solved.band_unknown)

    def test_a_model_in_memory_has_the_band_of_its_image(self):
        whole = pydimple.run(SAMPLE, nodes=1000, mu_Pa=321.1, depth_mm=0.5, frames=1)
        solved = pydimple.solve(pydimple.build_model(SAMPLE, nodes=1000), mu_Pa=321.1, depth_mm=0.5, frames=1)
        self.assertEqual(solved.band_unknown, "")
        np.testing.assert_array_equal(solved.band_low_N, whole.band_low_N)

    def test_the_number_of_threads_changes_no_bit(self):
        many = pydimple.run(SAMPLE, **FAST)
        pydimple.limit_threads(1)
        self.addCleanup(pydimple.limit_threads)
        one = pydimple.run(SAMPLE, **FAST)
        np.testing.assert_array_equal(one.displacement_m, many.displacement_m)
        np.testing.assert_array_equal(one.force_N, many.force_N)
        self.raised(pydimple.UsageError, pydimple.limit_threads, 0)

    def test_an_array_may_be_written_out_too(self):
        labels, to_lps = half_ellipsoid()
        result = pydimple.run(labels, affine=to_lps, space="LPS", out=self.folder / "out", write="force", **FAST)
        self.assertIn("force.csv", os.listdir(self.folder / "out"))
        self.assertEqual(json.loads((self.folder / "out" / "summary.json").read_text())["force_N"], result.force_N[-1])
        again = {"affine": to_lps, "space": "LPS", "out": self.folder / "out", **FAST}
        self.raised(pydimple.OutputError, pydimple.run, labels, **again)
        pydimple.run(labels, overwrite=True, **again)
        refused = self.raised(pydimple.UsageError, pydimple.run, labels, overwrite=True, write="images", **again)
        self.assertIn("memory", refused.fact)
        self.assertIn("out", self.raised(pydimple.UsageError, pydimple.run, SAMPLE, write="force").remedy)

    def test_several_tissues_have_materials_of_their_own(self):
        stiff = {2: {"mu_Pa": 2100, "nu": 0.499}}
        whole = pydimple.run(TWO_LABELS, tissue=stiff, **FAST)
        model = pydimple.build_model(TWO_LABELS, nodes=300, tissue=stiff)
        self.assertEqual(set(model.label), {1, 2})
        np.testing.assert_array_equal(pydimple.solve(model, tissue=stiff, depth_mm=0.5, frames=2).force_N, whole.force_N)
        self.assertGreater(whole.force_N[-1], 2 * pydimple.run(TWO_LABELS, **FAST).force_N[-1])

    def test_options_come_from_files_and_keywords_override_them(self):
        file = self.folder / "options.toml"
        file.write_text("[cloud]\nnodes = 300\n[load]\ndepth_mm = 0.5\n[solver]\nframes = 1\n")
        result = pydimple.run(SAMPLE, config=file, frames=2)
        np.testing.assert_array_equal(result.force_N, pydimple.run(SAMPLE, **FAST).force_N)

    def test_a_session_comes_to_the_force_of_a_run(self):
        result = pydimple.run(SAMPLE, time="quasi-static", **FAST)  # in equilibrium, as the session
        session = pydimple.Session(result.model)
        self.assertGreater(session.equilibrate(depth_mm=0.5), 0)
        self.assertAlmostEqual(session.depth_m, 0.5e-3)
        self.assertAlmostEqual(session.force_N / result.force_N[-1], 1, delta=1e-3)
        self.assertAlmostEqual(session.base_force_N / session.force_N, 1, delta=1e-3)
        np.testing.assert_allclose(
            session.positions_m, result.model.positions_m + session.displacement_m, rtol=0, atol=1e-15
        )
        before = session.positions_m
        error = self.raised(pydimple.SolveError, session.step, depth_mm=0.6, dt_s=1e4)
        self.assertIn("20000", error.why)
        np.testing.assert_array_equal(session.positions_m, before)
        self.assertGreater(session.step(depth_mm=0.51, dt_s=1e-4), 0)
        self.raised(pydimple.UsageError, session.step, depth_mm=0.6, dt_s=0)
        self.raised(pydimple.UsageError, session.equilibrate, depth_mm=float("nan"))

    def test_what_the_program_tells_goes_to_the_log(self):
        with self.assertLogs("pydimple", logging.INFO) as heard:
            model = pydimple.build_model(SAMPLE, nodes=300)
        self.assertTrue(any("circle" in line for line in heard.output))
        self.assertTrue(model.report["circle_reason"])
        self.assertIsInstance(model.warnings, list)


class Errors(InAFolder):
    def test_each_kind_of_failure_has_a_class_and_five_parts(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        error = self.raised(pydimple.UsageError, pydimple.run, SAMPLE, nodez=300)
        self.assertIn("did you mean nodes?", error.fact)
        self.assertIn("did you mean mu_Pa?", self.raised(pydimple.UsageError, pydimple.run, SAMPLE, mu=300).fact)
        self.raised(pydimple.UsageError, pydimple.run, SAMPLE, zzz=300)
        self.assertIn("build_model", self.raised(pydimple.UsageError, pydimple.solve, model, nodes=300).why)
        self.assertIn("solve", self.raised(pydimple.UsageError, pydimple.Session, model, depth_mm=3).why)
        self.assertEqual("nu", self.raised(pydimple.UsageError, pydimple.solve, model, nu=0.5).where)
        self.raised(pydimple.UsageError, pydimple.solve, model, mu_Pa=True)
        self.raised(pydimple.UsageError, pydimple.solve, model, mu_Pa={})
        self.raised(pydimple.UsageError, pydimple.solve, model, mu_Pa="3 kg")
        self.raised(pydimple.InputError, pydimple.build_model, SAMPLE, label=7)
        self.raised(pydimple.InputError, pydimple.solve, model, tissue={7: {"mu_Pa": 100}})
        self.raised(pydimple.ModelError, pydimple.solve, model, depth_mm=100)
        (self.folder / "else").write_text("of another program")
        self.raised(pydimple.OutputError, pydimple.run, SAMPLE, out=self.folder, **FAST)
        for kind in ("Usage", "Input", "Model", "Solve", "Output"):
            self.assertTrue(issubclass(getattr(pydimple, kind + "Error"), pydimple.Error))

    def test_errors_cross_processes_and_read_like_the_programs(self):
        error = self.raised(pydimple.InputError, pydimple.run, self.folder / "none.nrrd")
        there = pickle.loads(pickle.dumps(error))
        self.assertEqual((type(there), str(there), there.code), (type(error), str(error), error.code))
        said = subprocess.run(
            [PROGRAM, "run", self.folder / "none.nrrd", "-o", self.folder / "out"], stderr=subprocess.PIPE, text=True
        ).stderr
        self.assertIn(str(error), said)

    def test_a_mistake_of_types_is_pythons_own_error(self):
        with self.assertRaises(TypeError):
            pydimple.solve(SAMPLE)
        with self.assertRaises(TypeError):
            pydimple.Session("model")


LONG = {"nodes": 3000, "depth_mm": 8, "frames": 200, "time": "explicit"}
INTERRUPTED = f"""
import logging, pydimple
logging.basicConfig(level=logging.DEBUG, format="%(message)s")
try:
    pydimple.run({str(SAMPLE)!r}, **{LONG!r})
except pydimple.Error:
    print("caught as an error")
except KeyboardInterrupt as stopped:
    print("stopped", type(stopped).__name__, stopped.code, flush=True)
print(pydimple.run({str(SAMPLE)!r}, nodes=300, depth_mm=0.5, frames=2).summary["status"])
"""


class Stopping(InAFolder):
    def test_ctrl_c_ends_a_computation_and_another_may_begin(self):
        for word in ("image ", "load "):  # while the model is made; while it is solved
            child = subprocess.Popen(
                [sys.executable, "-c", INTERRUPTED], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
            with child:
                for line in child.stderr:
                    if line.startswith(word):
                        break
                child.send_signal(signal.SIGINT)
                said, _ = child.communicate(timeout=60)
            self.assertEqual(said, "stopped Stopped interrupted\nfinished\n")
            self.assertEqual(child.returncode, 0)

    def test_a_stop_is_no_error_and_a_keyboard_interrupt(self):
        self.assertTrue(issubclass(pydimple.Stopped, KeyboardInterrupt))
        self.assertFalse(issubclass(pydimple.Stopped, Exception))

    def at_the_first_line(self, act):
        class Handler(logging.Handler):
            def emit(self, record):
                logger.removeHandler(self)
                act()

        logger = logging.getLogger("pydimple")
        logger.addHandler(Handler())
        logger.setLevel(logging.INFO)
        self.addCleanup(logger.setLevel, logging.NOTSET)

    def test_a_signal_that_is_handled_disturbs_nothing(self):
        heard = []
        before = signal.signal(signal.SIGUSR1, lambda *_: heard.append("signal"))
        self.addCleanup(signal.signal, signal.SIGUSR1, before)
        self.at_the_first_line(lambda: os.kill(os.getpid(), signal.SIGUSR1))
        self.assertEqual(pydimple.run(SAMPLE, **FAST).summary["status"], "finished")
        self.assertEqual(heard, ["signal"])

    def test_what_a_handler_raises_ends_the_work_and_comes_through(self):
        def overdue(*_):
            raise TimeoutError("enough")

        before = signal.signal(signal.SIGUSR1, overdue)
        self.addCleanup(signal.signal, signal.SIGUSR1, before)
        self.at_the_first_line(lambda: os.kill(os.getpid(), signal.SIGUSR1))
        with self.assertRaisesRegex(TimeoutError, "enough"):
            pydimple.run(SAMPLE, **LONG)
        self.assertEqual(pydimple.run(SAMPLE, **FAST).summary["status"], "finished")

    def test_other_threads_run_while_one_computes(self):
        beside = []

        def compute():
            beside.append(pydimple.run(SAMPLE, **FAST).force_N)

        other = threading.Thread(target=compute)

        # At a line of this computation another one begins, and ends before this one goes on.
        def begin():
            other.start()
            other.join()

        self.at_the_first_line(begin)
        mine = pydimple.run(SAMPLE, **FAST).force_N
        np.testing.assert_array_equal(beside[0], mine)


class Stubs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.file = pathlib.Path(pydimple.__file__).with_name("__init__.pyi")
        cls.tree = ast.parse(cls.file.read_text())

    def test_the_package_says_that_it_is_typed(self):
        self.assertTrue(self.file.with_name("py.typed").exists())

    def test_stubs_and_module_have_the_same_names(self):
        stubs = {node.name: node for node in self.tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        self.assertEqual(set(stubs), set(pydimple.__all__))
        for name in ("Model", "Result", "Session"):
            said = {n.name for n in stubs[name].body if isinstance(n, ast.FunctionDef) and not n.name.startswith("_")}
            self.assertEqual(said, {n for n in dir(getattr(pydimple, name)) if not n.startswith("_")}, name)

    def test_stubs_and_module_take_the_same_arguments(self):
        for node in ast.walk(self.tree):
            if not isinstance(node, ast.FunctionDef) or node.name not in ("build_model", "solve", "run", "limit_threads"):
                continue
            said = [a.arg for a in node.args.posonlyargs + node.args.args + node.args.kwonlyargs]
            self.assertEqual(said, list(inspect.signature(getattr(pydimple, node.name)).parameters), node.name)
        session = next(n for n in self.tree.body if getattr(n, "name", "") == "Session").body[0].args
        said = [a.arg for a in session.args[1:] + session.kwonlyargs]
        self.assertEqual(said, list(inspect.signature(pydimple.Session).parameters))

    def test_every_option_has_one_keyword(self):
        self.assertEqual(len(pydimple._OPTIONS), len(pydimple._core.options()))
        shown = subprocess.run([PROGRAM, "options"], stdout=subprocess.PIPE, text=True, check=True).stdout
        for option in pydimple._OPTIONS.values():
            self.assertIn(option["key"], shown)

    def test_mypy_finds_nothing_wrong(self):
        if not shutil.which("mypy"):
            self.skipTest("mypy is not installed (Debian: mypy)")
        user = pathlib.Path("user.py")
        user.write_text(
            "import numpy as np\nimport pydimple\n"
            "result = pydimple.run('brain.nrrd', mu_Pa=210, nodes=1000, indent_at=(0, 0, 10), label=[1, 2])\n"
            "force: float = float(result.force_N[-1])\n"
            "session = pydimple.Session(result.model, mu_Pa='0.3kPa')\n"
            "count: int = session.equilibrate(depth_mm=0.5)\n"
        )
        checked = subprocess.run(
            ["mypy", "--python-executable", sys.executable, "--strict", str(user)], stdout=subprocess.PIPE, text=True
        )
        self.assertEqual(checked.returncode, 0, checked.stdout)
        user.write_text("import pydimple\npydimple.run('brain.nrrd', mu=210)\npydimple.run('brain.nrrd').force\n")
        checked = subprocess.run(
            ["mypy", "--python-executable", sys.executable, str(user)], stdout=subprocess.PIPE, text=True
        )
        self.assertEqual(checked.stdout.count("error:"), 2, checked.stdout)


class Documentation(InAFolder):
    def test_every_public_name_is_documented(self):
        for name in pydimple.__all__:
            thing = getattr(pydimple, name)
            self.assertTrue(thing.__doc__, name)
            if inspect.isclass(thing) and not issubclass(thing, BaseException):
                for attribute in (a for a in dir(thing) if not a.startswith("_")):
                    self.assertTrue(getattr(thing, attribute).__doc__, f"{name}.{attribute}")
        self.assertIn("mu_Pa : float, default 210.0\n    shear modulus", pydimple.solve.__doc__)

    def test_the_readmes_code_runs(self):
        text = (SOURCE / "apps" / "python" / "README.md").read_text()
        blocks = re.findall(r"```python\n(.*?)```", text, re.S)
        self.assertTrue(blocks)
        shutil.copy(SOURCE / "sample_data" / "brain_3mm.nrrd", self.folder / "brain.nrrd")
        code = "\n".join(blocks)
        if "nibabel" in code:
            try:
                import nibabel

                shutil.copy(TWO_LABELS, self.folder / "brain.nii.gz")
            except ImportError:
                self.skipTest("nibabel is not installed (Debian: python3-nibabel)")
        subprocess.run([sys.executable, "-c", code], cwd=self.folder, check=True, stdout=subprocess.DEVNULL)

    def test_the_example_ends_in_a_picture(self):
        try:
            import matplotlib
        except ImportError:
            self.skipTest("matplotlib is not installed (Debian: python3-matplotlib)")
        picture = (self.folder / "indentation.png").resolve()
        said = subprocess.run(
            [sys.executable, SOURCE / "apps" / "examples" / "indent.py", picture],
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        ).stdout
        self.assertIn("(discretisation)", said)
        self.assertGreater(picture.stat().st_size, 20000)


if __name__ == "__main__":
    unittest.main(verbosity=2)
