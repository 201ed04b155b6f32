"""Tests of the Python module as users install it: run by python_test in a fresh virtual environment with its wheel."""

import ast
import copy
import gc
import inspect
import json
import logging
import multiprocessing
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
import time
import unittest

import numpy as np

import pydimple

SOURCE = pathlib.Path(os.environ["DIMPLE_SOURCE"])
PROGRAM = os.environ["DIMPLE_PROGRAM"]
SAMPLE = SOURCE / "sample_data" / "block_3mm.nrrd"
TWO_LABELS = SOURCE / "sample_data" / "two_labels_3mm.nii.gz"
FAST = {"nodes": 300, "depth_mm": 0.5, "frames": 2}


def half_ellipsoid():
    """Labels 0 and 1 without symmetry along any axis, and their affine to LPS mm."""
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


LABELS, TO_LPS = half_ellipsoid()
HERE = {"affine": TO_LPS, "space": "LPS"}
BODY = {"image": LABELS, **HERE}


class InAFolder(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(dir="."))
        self.addCleanup(shutil.rmtree, self.folder)

    def raised(self, kind, *arguments, **keywords):
        """Error of a call; its five parts must not be empty."""
        call, *rest = arguments
        with self.assertRaises(kind) as caught:
            call(*rest, **keywords)
        error = caught.exception
        self.assertIs(type(error), kind)
        for part in (error.fact, error.where, error.why, error.remedy, error.code):
            self.assertTrue(part, f"a part is missing of: {error}")
        self.assertNotRegex(re.sub("`[^`]*`", "", str(error)), r"(^|[\s(])--?[a-z]", "a flag of the command line")
        return error


class Scenes(InAFolder):
    """Walls, tools, membranes, supports and steps are those of the command line."""

    def written(self, toml):
        file = self.folder / "options.toml"
        file.write_text(toml)
        return file

    def test_a_wall_and_a_further_tool_have_a_name_and_a_shape(self):
        scene = dict(nodes=1000, depth_mm=2, frames=1)
        alone = pydimple.run(**BODY, **scene, time="quasi-static")
        hull = pydimple.run(**BODY, **scene, walls={"hull": {"shape": "around:0mm", "friction": "0.3"}})
        self.assertGreater(hull.summary["walls"]["hull"]["places"], 20)
        self.assertEqual(hull.summary["walls"]["hull"]["friction"], 0.3)
        self.assertGreater(hull.force_N[-1], alone.force_N[-1])
        place = alone.summary["counts"]["circle_centre_mm"]
        other = {"shape": "sphere:4mm", "at": [place[0] + 14, place[1], place[2] - 1], "move": 1}
        ran = pydimple.run(**BODY, **scene, tools={"other": other})
        self.assertGreater(ran.summary["other_tools"]["other"]["force_on_tool_N"][2], 0.0)
        refused = self.raised(pydimple.UsageError, pydimple.run, **BODY, **scene, walls={"hull": {"shape": "no"}})
        self.assertIn("this names no wall", refused.why)
        refused = self.raised(pydimple.UsageError, pydimple.run, **BODY, **scene, tools={"other": {**other, "shape": "circle"}})
        self.assertIn("is a bonded indenter", refused.fact)

    def test_a_membrane_is_the_one_of_the_command_line_and_a_session_refuses_it(self):
        scene = dict(nodes=400, depth_mm=1, frames=1)
        pia = pydimple.run(**BODY, **scene, membranes={"pia": {"thickness_mm": 0.1, "mu_Pa": "50kPa"}})
        self.assertAlmostEqual(pia.summary["membranes"]["pia"]["stiffness_N_per_m"], 5)
        np.testing.assert_array_equal(pia.force_N, pydimple.run(**BODY, **scene, membrane="0.1mm:50kPa").force_N)
        self.assertGreater(pia.force_N[-1], pydimple.run(**BODY, **scene).force_N[-1])
        file = self.written("[membrane.pia]\nthickness_mm = 0.1\nmu_Pa = 5e4\n")
        np.testing.assert_array_equal(pia.force_N, pydimple.run(**BODY, **scene, config=file).force_N)
        error = self.raised(pydimple.UsageError, pydimple.Session, pydimple.build_model(**BODY, nodes=400), config=file)
        self.assertIn("has no membranes", error.fact)

    def test_a_support_is_the_one_of_the_command_line_and_a_session_holds_it_too(self):
        scene = dict(nodes=400, depth_mm=1, frames=1)
        supports = {"retractor": {"on": "left", "move_mm": (-1, 0, 0)}}
        file = self.written('[support.retractor]\non = "left"\nmove_mm = [-1, 0, 0]\n')
        held = pydimple.run(**BODY, **scene, supports=supports, pressures={"csf": {"pressure_Pa": 5, "on": "anterior"}})
        self.assertEqual(held.summary["supports"]["retractor"]["moved_mm"], [-1, 0, 0])
        self.assertEqual(held.summary["loads"]["pressure_Pa"], {"csf": 5})
        plain = pydimple.run(**BODY, **scene, supports=supports)
        np.testing.assert_array_equal(plain.force_N, pydimple.run(**BODY, **scene, config=file).force_N)
        model = pydimple.build_model(**BODY, nodes=400)
        session, alone = pydimple.Session(model, config=file), pydimple.Session(model)
        for of in (session, alone):
            of.equilibrate(depth_mm=1)
        self.assertNotEqual(session.force_N, alone.force_N)
        error = self.raised(pydimple.ModelError, pydimple.solve, model, supports={"strap": {"on": "superior"}}, depth_mm=1)
        self.assertIn("'strap'", error.fact)
        error = self.raised(pydimple.UsageError, pydimple.solve, model, supports={"strap": {"om": "left"}})
        self.assertEqual(error.where, "supports['strap']")

    def test_steps_are_done_in_the_order_of_the_dictionary(self):
        model = pydimple.build_model(**BODY, nodes=400)
        steps = {"z_press": {"move_mm": 1}, "a_drag": {"move_mm": (0.5, 0, 0)}}
        result = pydimple.solve(model, steps=steps, frames=2)
        self.assertEqual([step["name"] for step in result.summary["scene"]], ["z_press", "a_drag"])
        self.assertAlmostEqual(result.summary["indentation_mm"], 1.0, places=9)
        self.assertLess(result.summary["force_on_tool_N"][0], 0)
        error = self.raised(pydimple.UsageError, pydimple.solve, model, steps={"press": {"move_mm": (1, 2)}})
        self.assertIn("2 numbers", error.fact)
        error = self.raised(pydimple.UsageError, pydimple.Session, model, config=self.written("[step.press]\nmove_mm = 1\n"))
        self.assertIn("no steps", error.fact)


class Images(InAFolder):
    def test_an_array_of_any_type_and_order_gives_the_model_of_its_file(self):
        file = self.folder / "body.nrrd"
        write_nrrd(file, LABELS, TO_LPS)
        expected = pydimple.build_model(file, nodes=300)
        self.assertGreater(len(expected.positions_m), 250)
        types = ["?", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", ">i2"]
        for number, kind in enumerate(types):
            array = np.array(LABELS.astype(kind), order="CF"[number % 2])
            model = pydimple.build_model(array, affine=TO_LPS, space="LPS", nodes=300)
            np.testing.assert_array_equal(model.positions_m, expected.positions_m, err_msg=kind)
        strided = np.repeat(LABELS, 2, axis=1)[:, ::2]
        model = pydimple.build_model(strided, affine=TO_LPS, space="LPS", nodes=300)
        np.testing.assert_array_equal(model.points_m, expected.points_m)

    def test_arrays_in_either_order_are_read_where_they_are(self):
        for order in "CF":
            array = np.zeros((4, 5, 6), np.int16, order)
            self.assertTrue(np.shares_memory(pydimple._array("run", array), array))
            mask = array > 0
            self.assertTrue(np.shares_memory(pydimple._array("run", mask), mask))

    def test_the_space_of_the_affine_decides_which_way_is_left(self):
        in_ras = np.diag([-1, -1, 1, 1]) @ TO_LPS
        lps = pydimple.build_model(**BODY, nodes=300)
        ras = pydimple.build_model(LABELS, affine=in_ras, space="RAS", nodes=300)
        np.testing.assert_array_equal(ras.positions_m, lps.positions_m)
        wrong = pydimple.build_model(LABELS, affine=TO_LPS, space="RAS", nodes=300)
        self.assertGreater(np.abs(wrong.positions_m.mean(0) - lps.positions_m.mean(0)).max(), 0.01)

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
        run = pydimple.run
        usage, wrong = pydimple.UsageError, pydimple.InputError
        self.assertIn("both", self.raised(usage, run, LABELS).remedy)
        self.raised(usage, run, LABELS, affine=TO_LPS)
        self.raised(usage, run, LABELS, space="LPS")
        self.assertIn("RAS", self.raised(usage, run, LABELS, affine=TO_LPS, space="ras").remedy)
        self.raised(usage, run, SAMPLE, **HERE)
        self.raised(usage, run, LABELS, affine=TO_LPS[:3], space="LPS")
        self.raised(usage, run, LABELS, affine=TO_LPS.T, space="LPS")
        self.raised(usage, run, LABELS[0], **HERE)
        self.raised(usage, run, LABELS.astype(complex), **HERE)
        self.raised(usage, run, None, **HERE)
        self.raised(wrong, run, LABELS, affine=0 * TO_LPS + np.diag([0, 0, 0, 1.0]), space="LPS")
        nowhere = TO_LPS.copy()
        nowhere[0, 3] = np.nan
        self.raised(wrong, run, LABELS, affine=nowhere, space="LPS")
        self.raised(wrong, run, 0 * LABELS, **HERE)
        self.raised(wrong, run, LABELS[:, :, :1], **HERE)
        self.raised(wrong, run, LABELS[:0], **HERE)
        self.assertIn("(3, 4, 5)", self.raised(wrong, run, self.with_fault(LABELS, -1), **HERE).where)
        self.raised(wrong, run, self.with_fault(LABELS.astype(float), 0.5), **HERE)
        self.raised(wrong, run, self.with_fault(LABELS.astype(float), np.nan), **HERE)
        self.raised(wrong, run, self.folder / "none.nrrd")
        # Options without effect are refused.
        self.raised(usage, run, np.ma.masked_less(np.ones((9, 9, 9), np.uint8), 2), **HERE)
        self.raised(usage, run, SAMPLE, overwrite=True, **FAST)

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
            (result, "depth_m force_N base_force_N time_s force_on_tool_N moment_on_tool_Nm"),
            (result, "nodal_parameter_m frame_depth_m frame_time_s"),
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
        moved = result.nodal_parameter_m[-1][model.circle] @ model.push  # what the tool prescribes
        np.testing.assert_allclose(moved, 0.5e-3, atol=1e-9)
        np.testing.assert_allclose(result.displacement_m[-1][model.circle] @ model.push, 0.5e-3, rtol=0.01)
        np.testing.assert_allclose(result.nodal_parameter_m[-1][model.base], 0, atol=1e-12)
        self.assertAlmostEqual(model.volume_m3.sum(), 60e-3 * 60e-3 * 30e-3, delta=2e-6)
        self.assertAlmostEqual(model.circle_radius_m, 5e-3)
        at_surface = model.at_surface(result.nodal_parameter_m[-1])
        self.assertEqual(at_surface.shape, model.surface_mm.shape)
        self.assertEqual(model.at_surface(np.ones((n, 1))).shape, (len(model.surface_mm), 1))
        self.assertGreater((at_surface @ model.push).max(), 0.45e-3)
        self.assertLess(model.triangles.max(), len(model.surface_mm))
        self.raised(pydimple.UsageError, model.at_surface, np.ones((n + 1, 3)))

    def test_displacements_are_of_the_nodes_and_parameters_are_others(self):
        scene = dict(nodes=400, depth_mm=1, frames=1, band="off", supports={"strap": {"on": "left", "move_mm": (1, 0, 0)}})
        result = pydimple.run(SAMPLE, **scene)
        model, moved = result.model, result.displacement_m[-1]
        self.assertGreater(np.abs(result.nodal_parameter_m[-1] - moved).max(), 5e-5)
        # The surface at a node's place moves like the node.
        corner = np.linalg.norm(model.surface_mm[:, None] - 1e3 * model.positions_m[None], axis=2).argmin(0)
        near = np.linalg.norm(model.surface_mm[corner] - 1e3 * model.positions_m, axis=1) < 0.05
        self.assertGreater(near.sum(), 5)
        surface = model.at_surface(result.nodal_parameter_m[-1])[corner]
        self.assertLess(np.abs(surface - moved)[near].max(), 2e-5)

    def test_a_session_hands_over_arrays_of_their_own(self):
        session = pydimple.Session(pydimple.build_model(SAMPLE, nodes=300), mu_Pa=210)
        session.equilibrate(depth_mm=0.3)
        for name in ("positions_m", "displacement_m", "forces_N", "force_on_tool_N", "moment_on_tool_Nm"):
            array = getattr(session, name)
            self.assertEqual(array.shape[-1], 3)
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
        # Times and the places of options differ, and so do picture and page that show them.
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
            parts = {"parts_wall_s", "shown_surface"}  # of the command, which writes files too
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

    def test_a_force_has_three_components_a_moment_and_a_band_at_every_sample(self):
        result = pydimple.run(SAMPLE, nodes=1000, depth_mm=0.5, frames=3, indent_at="0,0,top")
        samples = len(result.force_N)
        self.assertGreaterEqual(samples, 3)
        for column in (result.force_on_tool_N, result.moment_on_tool_Nm):
            self.assertEqual(column.shape, (samples, 3))
        along = -result.force_on_tool_N @ result.model.push
        np.testing.assert_allclose(along, result.force_N, rtol=1e-6, atol=1e-9)
        self.assertEqual(list(result.force_on_tool_N[-1]), result.summary["force_on_tool_N"])
        self.assertEqual(list(result.moment_on_tool_Nm[-1]), result.summary["moment_on_tool_Nm"])
        self.assertEqual(result.band.low_N[-1], result.summary["band"]["low_N"])
        self.assertEqual(result.band.high_N[-1], result.summary["band"]["high_N"])
        self.assertTrue((result.band.low_N[1:] < result.force_N[1:]).all())
        np.testing.assert_array_equal(result.band.low_N, result.band_low_N)
        self.assertRegex(repr(result.band), r"^<pydimple.Band: [\d.]+ mN to [\d.]+ mN at the end>$")
        there = pickle.loads(pickle.dumps(result))
        self.assertEqual(there.moment_on_tool_Nm.tobytes(), result.moment_on_tool_Nm.tobytes())
        self.assertIsNone(pydimple.run(SAMPLE, **FAST).band)
        session = pydimple.Session(result.model)
        frame = session.follow(depth_mm=0.5, evaluations=500)
        session.equilibrate(depth_mm=0.5)
        np.testing.assert_allclose(session.force_on_tool_N, frame.force_on_tool_N, atol=0.02 * frame.force_N)
        self.assertAlmostEqual(-session.force_on_tool_N @ result.model.push / session.force_N, 1, delta=1e-6)
        self.assertEqual(session.moment_on_tool_Nm.shape, (3,))

    def test_the_number_of_threads_changes_no_bit(self):
        many = pydimple.run(SAMPLE, **FAST)
        pydimple.limit_threads(1)
        self.addCleanup(pydimple.limit_threads)
        one = pydimple.run(SAMPLE, **FAST)
        np.testing.assert_array_equal(one.displacement_m, many.displacement_m)
        np.testing.assert_array_equal(one.force_N, many.force_N)
        self.raised(pydimple.UsageError, pydimple.limit_threads, 0)

    def test_an_array_may_be_written_out_too(self):
        result = pydimple.run(**BODY, out=self.folder / "out", write="force", **FAST)
        self.assertIn("force.csv", os.listdir(self.folder / "out"))
        self.assertEqual(json.loads((self.folder / "out" / "summary.json").read_text())["force_N"], result.force_N[-1])
        again = {**HERE, "out": self.folder / "out", **FAST}
        self.raised(pydimple.OutputError, pydimple.run, LABELS, **again)
        pydimple.run(LABELS, overwrite=True, **again)
        refused = self.raised(pydimple.UsageError, pydimple.run, LABELS, overwrite=True, write="images", **again)
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

    def test_a_model_for_a_tool_that_touches_has_no_circle_to_move(self):
        model = pydimple.run(SAMPLE, nodes=500, tool="sphere:5mm", depth_mm=0.5, band="off").model
        for move in (pydimple.Session, lambda of: pydimple.solve(of, depth_mm=0.5)):
            self.assertIn("no nodes of a bonded patch", self.raised(pydimple.UsageError, move, model).fact)

    def test_supports_of_a_session_go_with_the_depth_that_they_go_with_in_a_run(self):
        scene = dict(supports={"strap": {"on": "left", "move_mm": (1, 0, 0)}}, depth_mm=1)
        model = pydimple.build_model(SAMPLE, nodes=300)
        session = pydimple.Session(model, **scene)
        session.equilibrate(depth_mm=1)
        self.assertAlmostEqual(session.force_N / pydimple.solve(model, band="off", **scene).force_N[-1], 1, delta=2e-3)

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
        self.assertTrue(any("contact" in line for line in heard.output))
        self.assertTrue(model.report["circle_reason"])
        self.assertIsInstance(model.warnings, list)


class Accuracies(InAFolder):
    LOAD = {"depth_mm": 2, "frames": 2}

    def assert_same_bits(self, one, other):
        for name in ("force_N", "force_on_tool_N", "band_low_N", "band_high_N", "displacement_m"):
            self.assertEqual(getattr(one, name).tobytes(), getattr(other, name).tobytes(), name)
        self.assertEqual(one.model.positions_m.tobytes(), other.model.positions_m.tobytes())
        self.assertEqual(one.warnings, other.warnings)
        levels = [[level["nodes"] for level in of.summary["ladder"]] for of in (one, other)]
        self.assertEqual(*levels)

    def test_a_model_is_refined_as_its_image_is(self):
        whole = pydimple.run(SAMPLE, accuracy="6%", **self.LOAD)
        model = pydimple.build_model(SAMPLE, nodes=300)
        for of in (model, pickle.loads(pickle.dumps(model)), whole.model):
            solved = pydimple.solve(of, accuracy="6%", **self.LOAD)
            self.assert_same_bits(solved, whole)
            self.assertEqual(solved.summary["made_from"]["image_sha256"], whole.summary["image_sha256"])
            self.assertEqual(solved.summary["made_from"]["circle"], solved.model.report["circle_reason"])
        self.assertEqual(len(model.positions_m), 300)
        self.assertLessEqual(whole.band.high_N[-1] - whole.force_N[-1], 0.06 * whole.force_N[-1])

    def test_the_cloud_that_was_fine_enough_has_a_band_when_it_is_solved_again(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        for result in (pydimple.run(SAMPLE, accuracy="6%", **self.LOAD), pydimple.solve(model, accuracy="6%", **self.LOAD)):
            again = pydimple.solve(pickle.loads(pickle.dumps(result.model)), **self.LOAD)
            self.assertEqual(again.band_unknown, "")
            self.assertEqual(again.force_N.tobytes(), result.force_N.tobytes())
        once_more = pydimple.solve(again.model, **self.LOAD)
        self.assertEqual(once_more.band.low_N.tobytes(), again.band.low_N.tobytes())
        self.assertIs(once_more.model, again.model)

    def test_tissues_of_an_array_and_places_of_an_organ_are_refined_too(self):
        stiff = {2: {"mu_Pa": 600}}
        organ = pydimple.Organ(TWO_LABELS, nodes=400, tissue=stiff)
        model = pickle.loads(pickle.dumps(organ.build_model(indent_at="anterior")))
        whole = pydimple.run(TWO_LABELS, tissue=stiff, indent_at="anterior", accuracy="10%", **self.LOAD)
        self.assert_same_bits(pydimple.solve(model, tissue=stiff, accuracy="10%", **self.LOAD), whole)
        whole = pydimple.run(LABELS, accuracy="10%", **HERE, **self.LOAD)
        solved = pydimple.solve(pydimple.build_model(LABELS, **HERE), accuracy="10%", **self.LOAD)
        self.assert_same_bits(solved, whole)
        self.assertEqual(solved.summary["made_from"]["image_sha256"], whole.summary["image_sha256"])

    def test_the_displacement_of_a_place_has_an_error_and_an_accuracy(self):
        place = {"quantity": "displacement@0,0,25", **self.LOAD}
        whole = pydimple.run(SAMPLE, nodes=1000, **place).summary["displacement"]
        model = pydimple.build_model(SAMPLE, nodes=1000)
        self.assertEqual(pydimple.solve(model, **place).summary["displacement"], whole)
        self.assertGreater(whole["half_mm"], 0)
        refined = pydimple.solve(model, accuracy="15%", **place).summary["displacement"]
        self.assertLessEqual(refined["half_mm"], 0.15 * refined["length_mm"])
        outside = {**place, "quantity": "displacement@0,0,900"}
        self.assertEqual(self.raised(pydimple.UsageError, pydimple.solve, model, **outside).where, "quantity=")

    def test_a_budget_ends_with_what_there_is_and_a_band_may_be_left_out(self):
        model = pydimple.build_model(SAMPLE, nodes=1000)
        hasty = pydimple.solve(model, accuracy="2%", budget_s=0.001, **self.LOAD)
        self.assertEqual(len(hasty.summary["ladder"]), 1)
        self.assertIsNone(hasty.band)
        self.assertTrue(any("was not reached" in warning for warning in hasty.warnings), hasty.warnings)
        self.assertIsNone(pydimple.solve(model, band="off", **self.LOAD).band)

    def test_an_accuracy_that_cannot_be_told_is_refused(self):
        paper = pydimple.build_model(SAMPLE, nodes=300, scheme="horton2007")
        self.assertIn("accuracy", self.raised(pydimple.UsageError, pydimple.solve, paper, accuracy="5%").fact)
        model = pydimple.run(TWO_LABELS, **FAST).model  # of one tissue, so that no labels were kept
        several = {"tissue": {2: {"mu_Pa": 600}}, "accuracy": "5%"}
        self.assertIn("labels", self.raised(pydimple.UsageError, pydimple.solve, model, **several).why)
        self.raised(pydimple.UsageError, pydimple.solve, model, accuracy="good")
        self.raised(pydimple.UsageError, pydimple.solve, model, accuracy="0.01%")
        self.raised(pydimple.UsageError, pydimple.build_model, SAMPLE, accuracy="5%")


def force_of(model):
    """Summary and force of a model in another process."""
    return repr(model), pydimple.solve(model, depth_mm=0.5, frames=1)


class Pickles(InAFolder):
    def assert_the_same(self, one, other, names):
        self.assertEqual(repr(one), repr(other))
        for name in names.split():
            a, b = getattr(one, name), getattr(other, name)
            if isinstance(a, np.ndarray):
                self.assertEqual((a.dtype, a.shape, a.tobytes()), (b.dtype, b.shape, b.tobytes()), name)
            else:
                self.assertEqual(a, b, name)

    def assert_the_same_model(self, one, other):
        self.assertIsNot(one, other)
        names = "positions_m points_m volume_m3 label base circle circle_centre_m circle_radius_m push surface_mm triangles"
        self.assert_the_same(one, other, names + " report warnings")
        u = np.random.default_rng(3).normal(size=one.positions_m.shape)
        self.assertEqual(one.at_surface(u).tobytes(), other.at_surface(u).tobytes())

    def assert_the_same_result(self, one, other):
        names = "depth_m force_N base_force_N time_s band_low_N band_high_N band_unknown displacement_m frame_depth_m"
        names += " force_on_tool_N moment_on_tool_Nm"
        self.assert_the_same(one, other, names + " frame_time_s warnings summary")
        self.assert_the_same_model(one.model, other.model)

    def test_a_model_comes_out_of_a_pickle_with_all_its_bits(self):
        stiff = {2: {"mu_Pa": 600, "nu": 0.499}}
        brain = SOURCE / "sample_data" / "brain_3mm.nrrd"  # whose fissure nodes do not see each other across
        for image, options in ((SAMPLE, {}), (TWO_LABELS, {"tissue": stiff}), (brain, {"close_mm": 6}), (brain, {})):
            model = pydimple.build_model(image, nodes=300, **options)
            for there in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
                self.assert_the_same_model(model, there)
            load = {"depth_mm": 0.5, "frames": 1, "tissue": options.get("tissue")}
            before, after = pydimple.solve(model, **load), pydimple.solve(there, **load)
            self.assertEqual(before.displacement_m.tobytes(), after.displacement_m.tobytes())
            self.assertEqual(before.force_N.tobytes(), after.force_N.tobytes())

    def test_a_model_out_of_a_pickle_has_its_band_and_works_in_sessions(self):
        model = pydimple.build_model(TWO_LABELS, nodes=1000, tissue={2: {"mu_Pa": 600}})
        there = pickle.loads(pickle.dumps(model))
        load = {"depth_mm": 0.5, "frames": 1, "tissue": {2: {"mu_Pa": 600}}}
        before, after = pydimple.solve(model, **load), pydimple.solve(there, **load)
        self.assertEqual(before.band_unknown, "")
        self.assertEqual(before.band_low_N.tobytes(), after.band_low_N.tobytes())
        sessions = [pydimple.Session(of, tissue=load["tissue"]) for of in (model, there)]
        for session in sessions:
            session.equilibrate(depth_mm=0.3)
        self.assertEqual(sessions[0].forces_N.tobytes(), sessions[1].forces_N.tobytes())

    def test_a_result_comes_out_of_a_pickle_with_all_its_bits(self):
        for nodes in (300, 1000):  # without and with error bounds
            result = pydimple.run(SAMPLE, nodes=nodes, depth_mm=0.5, frames=2)
            for there in (pickle.loads(pickle.dumps(result)), copy.deepcopy(result)):
                self.assert_the_same_result(result, there)
        again = [pydimple.solve(of.model, depth_mm=0.5, frames=1) for of in (result, there)]
        self.assertEqual(again[0].band_high_N.tobytes(), again[1].band_high_N.tobytes())
        self.assertIsNot(pickle.loads(pickle.dumps((there, there.model)))[1], there.model)
        one, its_model = pickle.loads(pickle.dumps((there, there.model)))
        self.assertIs(one.model, its_model)

    def test_models_go_to_other_processes_and_results_come_back(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        with multiprocessing.get_context("spawn").Pool(2) as pool:
            (said, result), _ = pool.map(force_of, [model, model])
        self.assertEqual(said, repr(model))
        here = pydimple.solve(model, depth_mm=0.5, frames=1)
        self.assertEqual(here.displacement_m.tobytes(), result.displacement_m.tobytes())

    def test_a_pickle_of_another_version_or_a_damaged_one_is_refused(self):
        rebuild, arguments, (state,), *_ = pydimple.build_model(SAMPLE, nodes=300).__reduce_ex__(2)
        for bad in (state[: len(state) // 2], state.replace(b"pydimple model", b"pydimple madel"), b""):
            error = self.raised(pydimple.InputError, rebuild(*arguments).__setstate__, (bad,))
            self.assertIn("model", error.fact)
        self.raised(pydimple.InputError, rebuild(*arguments).__setstate__, ())
        with self.assertRaises(TypeError):
            pickle.dumps(pydimple.Session(pydimple.build_model(SAMPLE, nodes=300)))


class Following(InAFolder):
    @classmethod
    def setUpClass(cls):
        cls.model = pydimple.build_model(SAMPLE, nodes=600)

    def follow(self, depths_mm, **limit):
        session = pydimple.Session(self.model)
        return [session.follow(depth_mm=depth, **limit) for depth in depths_mm]

    def test_a_frame_has_the_force_of_equilibrium_and_says_how_far_it_is_from_it(self):
        frame = self.follow([1], evaluations=500)[0]
        session = pydimple.Session(self.model)
        session.equilibrate(depth_mm=1)
        self.assertEqual((frame.status, frame.asked_mm), ("there", 1))
        self.assertAlmostEqual(frame.depth_mm, 1)
        self.assertAlmostEqual(frame.force_N / session.force_N, 1, delta=2e-3)
        self.assertLess(frame.error_N, 0.02 * frame.force_N)
        self.assertAlmostEqual(-np.dot(frame.force_on_tool_N, self.model.push), frame.force_N, delta=1e-6 * frame.force_N)
        np.testing.assert_allclose(np.array(frame.force_direction) * frame.force_N, frame.force_on_tool_N, rtol=1e-9)
        self.assertEqual(len(frame.moment_on_tool_Nm), 3)
        self.assertTrue(0 < frame.evaluations <= 500 and frame.residual < 1e-2)
        beside = self.follow([0.9, 1.1], evaluations=500)
        slope = (beside[1].force_N - beside[0].force_N) / 0.2e-3
        self.assertAlmostEqual(frame.stiffness_N_per_m / slope, 1, delta=0.2)

    def test_the_tool_lags_catches_up_is_lifted_and_goes_no_deeper_than_the_body(self):
        session = pydimple.Session(self.model)
        frame = session.follow(depth_mm=3, evaluations=3)
        self.assertEqual((frame.status, frame.error_N), ("lags", float("inf")))  # of the depth that was requested
        self.assertIn("error unknown, lags", repr(frame))
        self.assertLess(frame.error_at_depth_N, float("inf"))
        self.assertLess(frame.depth_mm, 3)
        for _ in range(300):
            frame = session.follow(depth_mm=3, evaluations=8)
        self.assertEqual(frame.status, "there")
        lifted = session.follow(depth_mm=-1, seconds=0.01)
        self.assertEqual((lifted.force_N, lifted.depth_mm, lifted.status), (0, 0, "there"))
        self.assertEqual(session.follow(depth_mm=100, seconds=0.01).status, "beyond")

    def test_frames_of_so_many_evaluations_are_the_same_bits_each_time_and_cross_processes(self):
        first, second = (self.follow(np.linspace(0.1, 2, 20), evaluations=8) for _ in range(2))
        self.assertEqual(first, second)
        self.assertEqual(pickle.loads(pickle.dumps(first)), first)

    def test_tissue_relaxes_for_the_seconds_of_a_frame_unless_another_time_is_given(self):
        def last(**time):
            session = pydimple.Session(self.model, prony_g=[0.5], prony_tau_s=[1])
            return [session.follow(depth_mm=1, evaluations=60, **time) for _ in range(50)][-1].force_N

        relaxed, still = last(), last(dt_s=0)
        self.assertEqual(last(dt_s=0.04), relaxed)
        self.assertAlmostEqual(relaxed / still, 1 - 0.5 * (1 - np.exp(-49 * 0.04)), delta=0.02)

    def test_a_cut_beside_the_tool_softens_the_body(self):
        session = pydimple.Session(self.model)
        for depth in np.linspace(0.1, 2, 20):
            before = session.follow(depth_mm=depth, evaluations=20)
        count = len(session.positions_m)
        top = session.positions_m[:, 2].max() * 1e3
        session.cut(from_mm=(9, -8, top), to_mm=(9, 8, top), depth_mm=12)
        self.assertGreater(len(session.positions_m), count)
        lagging = session.follow(depth_mm=2, evaluations=1)
        self.assertGreaterEqual(lagging.error_N, lagging.force_N)
        for _ in range(10):
            after = session.follow(depth_mm=2, evaluations=20)
        self.assertEqual(after.status, "there")
        self.assertLess(after.force_N, 0.99 * before.force_N)
        self.assertGreater(after.force_N, 0.7 * before.force_N)

    def test_a_cut_that_opens_nothing_is_refused_and_leaves_the_body_as_it_was(self):
        session = pydimple.Session(self.model)
        session.equilibrate(depth_mm=1)
        force, count = session.force_N, len(session.positions_m)
        self.raised(pydimple.ModelError, session.cut, from_mm=(9, -8, 200), to_mm=(9, 8, 200), depth_mm=1)
        self.raised(pydimple.UsageError, session.cut, from_mm=(9, 8, 20), to_mm=(9, 8, 20), depth_mm=1)
        self.raised(pydimple.UsageError, session.cut, from_mm=(9, -8, 20), to_mm=(9, 8, 20), depth_mm=0)
        self.assertEqual((session.force_N, len(session.positions_m)), (force, count))

    def test_a_frame_keeps_its_time(self):
        began = time.process_time()  # of all threads: the machine may be busy with other things
        frames = self.follow(np.linspace(0.1, 4, 20), seconds=0.02)
        self.assertLess(time.process_time() - began, (20 * 0.02 + 2) * os.cpu_count())
        self.assertTrue(all(frame.evaluations > 0 for frame in frames))

    def test_what_no_frame_can_be_is_refused(self):
        session = pydimple.Session(self.model)
        for bad in ({"depth_mm": float("inf")}, {"seconds": 0}, {"evaluations": -1}, {"dt_s": -1}):
            error = self.raised(pydimple.UsageError, session.follow, **{"depth_mm": 1, **bad})
            self.assertTrue(error.fact.startswith(f"{list(bad)[0]}="), error.fact)
        paper = pydimple.build_model(SAMPLE, nodes=300, scheme="horton2007")
        self.raised(pydimple.SolveError, pydimple.Session(paper).follow, depth_mm=1)


class Organs(InAFolder):
    def test_an_organ_gives_the_models_of_its_image_at_every_place(self):
        for image, given in ((LABELS, HERE), (TWO_LABELS, {"tissue": {2: {"mu_Pa": 900}}, "label": [1, 2]})):
            organ = pydimple.Organ(image, nodes=300, indenter_diameter_mm=12, **given)
            places = [{}, {"indent_at": "opposite,left"}, {"indent_at": "anterior"}, {"nodes": 400, "base": "organ"}]
            for place in places:
                model = organ.build_model(**place)
                alone = pydimple.build_model(image, **{"nodes": 300, "indenter_diameter_mm": 12, **given, **place})
                self.assertEqual(model.positions_m.tobytes(), alone.positions_m.tobytes())
                self.assertEqual(model.points_m.tobytes(), alone.points_m.tobytes())
                self.assertEqual(model.warnings, alone.warnings)
                self.assertEqual(set(model.report), set(alone.report))

    def test_a_model_of_an_organ_is_as_any_other(self):
        organ = pydimple.Organ(SAMPLE, nodes=1000)
        model, alone = organ.build_model(indent_at="0,0,top"), pydimple.build_model(SAMPLE, nodes=1000, indent_at="0,0,top")
        del organ
        gc.collect()
        mine, its = (pydimple.solve(of, depth_mm=0.5, frames=1) for of in (pickle.loads(pickle.dumps(model)), alone))
        self.assertEqual(mine.force_N.tobytes(), its.force_N.tobytes())
        self.assertEqual(mine.band_low_N.tobytes(), its.band_low_N.tobytes())

    def test_it_knows_where_the_tool_may_stand(self):
        organ = pydimple.Organ(SAMPLE)
        self.assertEqual(organ.usable_places(), pydimple.usable_places(SAMPLE))
        there = organ.usable_places(indent_at="anterior")
        self.assertEqual(there, pydimple.usable_places(SAMPLE, indent_at="anterior"))
        self.assertIsInstance(organ.warnings, list)

    def test_what_its_surface_hangs_on_is_asked_of_the_organ_alone(self):
        organ = pydimple.Organ(SAMPLE)
        for option in ({"label": 1}, {"close_mm": 3}, {"indenter_diameter_mm": 12}):
            self.assertIn("Organ", self.raised(pydimple.UsageError, organ.build_model, **option).why)
        self.assertEqual("indent_at=", self.raised(pydimple.ModelError, organ.build_model, indent_at=(0, 0, 500)).where)
        self.raised(pydimple.UsageError, organ.build_model, base="bottomless")


# Flags of messages that no call of pydimple can meet.
NOT_IN_PYTHON = {
    "--time-limit": "a call has no time limit of its own; who wants one raises from a signal handler",
    "--shape": "of `dimple phantom`",
    "--size": "of `dimple phantom`",
    "--elements": "of `dimple export`",
    "--format": "of `dimple export`",
    "--socket": "of `dimple poke`",
    "--explain": "of `dimple run`",
}


def flags_of_messages():
    """Flag -> string literals of the library's sources that name it, with numbers for inserted values."""
    found = {}
    for folder in ("io", "preprocess", "solver", "apps/run"):
        for file in (SOURCE / folder).rglob("*.[ch]pp"):
            code = re.sub(r"^\s*(//|#).*$|\s//.*$", "", file.read_text(), flags=re.M)
            code = re.sub(r'"\s*\n\s*"', "", code)  # one message over several lines
            for literal in re.findall(r'"((?:[^"\\\n]|\\.)*)"', code):
                for flag in re.findall(r"(?<![\w!<-])(--[a-z][a-z-]*|-o\b)", literal):
                    found.setdefault(flag, set()).add(re.sub(r"\{[^{}]*\}", "7", literal))
    return found


class Words(InAFolder):
    def test_every_flag_of_a_message_is_a_keyword_or_cannot_come_up(self):
        from pydimple import _errors

        flags = flags_of_messages()
        self.assertGreater(len(flags), 40)  # all are found
        self.assertLess({"--nodes", "--depth", "--time-limit", "--socket", "-o"}, set(flags))
        known = {**_errors.OF_FLAG, **_errors.OTHER_FLAGS, "--set": "any option"}
        self.assertEqual({flag for flag in flags if flag not in known and flag not in NOT_IN_PYTHON}, set())
        self.assertFalse(set(known) & set(NOT_IN_PYTHON))
        for flag, messages in flags.items():
            for message in messages if flag in known else ():
                said = re.sub("`[^`]*`", "", _errors.in_keywords(message))
                left = set(re.findall(r"(?<![\w!<-])(--[a-z][a-z-]*|-o\b)", said)) - set(NOT_IN_PYTHON)
                # a bare flag is combined with others or searched for, and is no message
                self.assertTrue(not left or message in ("--", "--set"), f"{message}\n{said}")

    def test_flags_become_keywords_as_they_are_written_in_python(self):
        from pydimple._errors import in_keywords

        for flags, keywords in (
            ("use more nodes (--nodes) or a smaller --depth", "use more nodes (nodes=) or a smaller depth_mm="),
            ("give a smaller --depth, or --time explicit", 'give a smaller depth_mm=, or time="explicit"'),
            ("on where a body has folds; give --nodes 4000", "on where a body has folds; give nodes=4000"),
            ("spacing at the edge of the contact patch (--rim 0.15 or more)", "spacing at the edge of the contact patch (rim=0.15 or more)"),
            ("for a brain about --close 4mm", "for a brain about close_mm=4"),
            ("leave --stress out, or the preset", "leave stress= out, or the preset"),
            ("--stress printed (material.stress)", 'stress="printed"'),
            ("--depth (load.depth_mm)", "depth_mm="),
            ("--accuracy (accuracy.goal) or --budget (accuracy.budget_s)", "accuracy= or budget_s="),
            ("--warp, --warp-labels (output.warp, output.warp_labels)", "warp=, warp_labels="),
            ("steps of the load (--set solver.step_radii=0.05), a", "steps of the load (step_radii=0.05), a"),
            ("more points (--set grid.ratio)", "more points (ratio=)"),
            ("as in --set tissue.2.mu=300Pa", 'as in tissue={2: {"mu_Pa": 300}}'),
            ("for instance --direction 0,0,-1 to press", "for instance direction=(0, 0, -1) to press"),
            ("--indent-at superior,left", 'indent_at="superior,left"'),
            ("choose several with --label 1,2, or leave --label out", "choose several with label=[1, 2], or leave label= out"),
            ("add --write all,images or --warp IMAGE", 'add write=["all", "images"] or warp=IMAGE'),
            ("another folder with -o, or --force to replace it", "another folder with out=, or overwrite=True to replace it"),
            ("use a smaller solver.safety, for instance", "use a smaller safety=, for instance"),
            ("material.nu = 0.5 is not allowed", "nu=0.5 is not allowed"),
            ("material.young_Pa = 0 unsets it", "young_Pa=0 unsets it"),
            ("`dimple places` lists the others", "pydimple.usable_places lists the others"),
            ("; `dimple run --resume` continues", "; `dimple run --resume` continues"),
        ):
            self.assertEqual(in_keywords(flags), keywords)

    def test_errors_warnings_and_the_log_name_keywords(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        deep = self.raised(pydimple.ModelError, pydimple.solve, model, depth_mm=100)
        self.assertEqual(deep.where, "depth_mm=")
        self.assertEqual(deep.remedy, "give a smaller depth_mm=, or another place with indent_at=")
        word = self.raised(pydimple.UsageError, pydimple.solve, model, contact="sticky")
        self.assertEqual((word.fact, word.where), ('contact="sticky" is not allowed', "contact="))
        self.assertIn("nodes=1000", pydimple.solve(model, depth_mm=0.5, frames=1).band_unknown)
        with self.assertLogs("pydimple", logging.INFO) as heard:
            result = pydimple.run(TWO_LABELS, **FAST)
        self.assertTrue(any("label=" in line and "tissue={" in line for line in heard.output), heard.output)
        self.assertTrue(any("mu_Pa=" in line for line in heard.output), heard.output)
        for line in heard.output + result.warnings + result.model.warnings:
            self.assertNotRegex(line, "(^|[ (])--[a-z]")

    def test_a_file_of_options_is_told_of_in_its_own_keys(self):
        file = self.folder / "options.toml"
        file.write_text("[material]\nnu = 0.5\n")
        error = self.raised(pydimple.UsageError, pydimple.run, SAMPLE, config=file)
        self.assertEqual((error.fact, error.where), ("material.nu = 0.5 is not allowed", f"{file}, line 2"))

    def test_a_keyword_counts_as_a_flag_does_beside_a_preset_and_a_file(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        preset = {"preset": "horton_2007", "depth_mm": 0.5, "frames": 1}
        given = pydimple.solve(model, mu_Pa=420, **preset).force_N[-1] / pydimple.solve(model, mu_Pa=210, **preset).force_N[-1]
        self.assertAlmostEqual(given, 2, delta=1e-3)
        file = self.folder / "options.toml"
        file.write_text("[material]\nmu_Pa = 420\n")
        of_preset = pydimple.solve(model, config=file, **preset)
        np.testing.assert_array_equal(of_preset.force_N, pydimple.solve(model, **preset).force_N)

    def test_dir_shows_what_is_meant_for_users(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        result, session = pydimple.solve(model, depth_mm=0.5, frames=1), pydimple.Session(model)
        shown = {name for name in dir(pydimple) if not name.startswith("__")}
        self.assertEqual(shown, set(pydimple.__all__))
        things = [model, result, session, session.follow(depth_mm=0.1), pydimple.Organ(SAMPLE), pydimple.Error("fact")]
        things += [getattr(pydimple, name) for name in pydimple.__all__]
        for thing in things:
            private = [name for name in dir(thing) if name.startswith("_") and not name.endswith("__")]
            self.assertEqual(private, [], repr(thing))

    def test_every_object_says_what_it_is(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        session = pydimple.Session(model)
        session.equilibrate(depth_mm=2)
        frame = session.follow(depth_mm=1, evaluations=100)
        force = r"[\d.]+ mN at {}\.00 mm"
        for thing, pattern in (
            (model, r"Model: \d+ nodes, \d+ integration points, contact patch 10\.00 mm wide"),
            (pydimple.Organ(SAMPLE), r"Organ: 108 cm3, \d+ triangles"),
            (pydimple.solve(model, depth_mm=2, frames=1), r"Result: " + force.format(2) + r", no error estimate: .*\(nodes=1000\)"),
            (pydimple.Session(model), r"Session: \d+ nodes, 0 N at 0\.00 mm"),
            (frame, "Frame: " + force.format(1) + r", error [\d.]+ [mun]?N, there"),
            (pydimple.UsageError("no such thing"), "UsageError: no such thing"),
        ):
            self.assertRegex(repr(thing), f"^<pydimple.{pattern}>$")
        session.equilibrate(depth_mm=2)
        self.assertRegex(repr(session), r"^<pydimple.Session: \d+ nodes, " + force.format(2) + ">$")
        for name in pydimple.__all__:
            self.assertEqual(getattr(pydimple, name).__module__, "pydimple", name)


class Errors(InAFolder):
    def test_each_kind_of_failure_has_a_class_and_five_parts(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        error = self.raised(pydimple.UsageError, pydimple.run, SAMPLE, nodez=300)
        self.assertIn("did you mean nodes?", error.fact)
        self.assertIn("did you mean mu_Pa?", self.raised(pydimple.UsageError, pydimple.run, SAMPLE, mu=300).fact)
        self.raised(pydimple.UsageError, pydimple.run, SAMPLE, zzz=300)
        self.assertIn("build_model", self.raised(pydimple.UsageError, pydimple.solve, model, nodes=300).why)
        self.assertIn("solve", self.raised(pydimple.UsageError, pydimple.Session, model, frames=3).why)
        self.assertEqual("nu=", self.raised(pydimple.UsageError, pydimple.solve, model, nu=0.5).where)
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
        session = pydimple.Session(pydimple.build_model(SAMPLE, nodes=300))
        with self.assertRaises(TypeError) as raised:
            session.follow(depth_mm="1mm")
        self.assertIn("depth_mm:", str(raised.exception))
        self.assertNotIn("anonymous", str(raised.exception))

    def test_what_is_meant_is_what_the_function_takes(self):
        model = pydimple.build_model(SAMPLE, nodes=300)
        for keyword in ("tools", "membranes", "steps"):
            error = self.raised(pydimple.UsageError, pydimple.Session, model, **{keyword: {}})
            self.assertEqual(error.fact, f"Session has no option {keyword}")
            self.assertIn("run", error.why)
        for keyword in ("frame", "nodez", "progress"):
            fact = self.raised(pydimple.UsageError, pydimple.Session, model, **{keyword: 1}).fact
            for meant in re.findall("did you mean (.*)[?]", fact):
                with self.assertRaises(Exception) as raised:
                    pydimple.Session(model, **{meant: object()})
                self.assertNotIn("has no option", str(raised.exception))


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
                said, _ = child.communicate()
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

        # At a line of this computation another one begins, and ends before this one continues.
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
        for name in ("Model", "Organ", "Result", "Session"):
            said = {n.name for n in stubs[name].body if isinstance(n, ast.FunctionDef) and not n.name.startswith("_")}
            self.assertEqual(said, {n for n in dir(getattr(pydimple, name)) if not n.startswith("_")}, name)

    def test_stubs_and_module_take_the_same_arguments(self):
        for node in ast.walk(self.tree):
            functions = ("build_model", "usable_places", "solve", "run", "limit_threads")
            if not isinstance(node, ast.FunctionDef) or node not in self.tree.body or node.name not in functions:
                continue
            said = [a.arg for a in node.args.posonlyargs + node.args.args + node.args.kwonlyargs]
            self.assertEqual(said, list(inspect.signature(getattr(pydimple, node.name)).parameters), node.name)
        for name in ("Session", "Organ"):
            stub = next(n for n in self.tree.body if getattr(n, "name", "") == name)
            for method in (n for n in stub.body if isinstance(n, ast.FunctionDef) and not n.decorator_list):
                thing = getattr(pydimple, name) if method.name == "__init__" else getattr(getattr(pydimple, name), method.name)
                said = [a.arg for a in method.args.args + method.args.kwonlyargs]
                if name == "Session" and method.name in ("cut", "equilibrate", "step"):
                    continue  # of the extension, which has no signatures
                own = list(inspect.signature(thing).parameters)
                self.assertEqual(said[said[:1] != own[:1] and said[0] == "self":], own, f"{name}.{method.name}")

    def words_of(self, annotation):
        """Words of all Literals of a type."""
        literals = [n for n in ast.walk(annotation) if isinstance(n, ast.Subscript) and getattr(n.value, "id", "") == "Literal"]
        return [c.value for n in literals[:1] for c in ast.walk(n.slice) if isinstance(c, ast.Constant)]

    def words_of_keywords(self):
        found = {}
        for node in ast.walk(self.tree):
            if isinstance(node, ast.FunctionDef):
                for argument in node.args.args + node.args.kwonlyargs:
                    if argument.annotation and argument.arg not in ("self", "space"):
                        words = self.words_of(argument.annotation)
                        self.assertEqual(found.setdefault(argument.arg, words), words, argument.arg)
        return {keyword: words for keyword, words in found.items() if words}

    def test_words_of_the_stubs_are_those_that_the_program_takes(self):
        said = self.words_of_keywords()
        one_of = {k for k, o in pydimple._OPTIONS.items() if o["choices"]}
        self.assertLess({"contact", "time", "precision", "preset", "scheme", "band", "write"}, one_of)
        self.assertLess(one_of | {"base", "indent_at", "direction"}, set(said))
        for keyword in one_of:  # the refusal of another word lists them
            with self.assertRaises(pydimple.UsageError) as refused:
                pydimple.run(SAMPLE, out="never", **{keyword: "another"})
            listed = re.search(r": give (?:one|some) of (.*)$", refused.exception.remedy)[1].split(", ")
            self.assertEqual(said[keyword], listed, keyword)
        for keyword in ("base", "indent_at"):
            with self.assertRaises(pydimple.UsageError) as refused:
                pydimple.usable_places(SAMPLE, **{keyword: "another"})
            listed = set(re.findall(r"[a-z]{4,}", refused.exception.why.split("one of")[0])) - {"side", "place", "base", "patient"}
            self.assertEqual(set(said[keyword]), listed, keyword)
            for word in said[keyword]:
                pydimple.usable_places(SAMPLE, **{keyword: word})
        for keyword, where in (("direction", pydimple.build_model), ("label_names", pydimple.build_model)):
            for word in said[keyword]:
                where(SAMPLE, nodes=300, **{keyword: word})
            with self.assertRaises(pydimple.Error):
                where(SAMPLE, nodes=300, **{keyword: "another"})
        self.assertEqual({k: said[k] for k in ("quantity", "compare")}, {"quantity": ["force"], "compare": ["horton2007"]})

    def test_words_of_a_frame_are_those_of_the_live_socket(self):
        frame = next(n for n in self.tree.body if getattr(n, "name", "") == "Frame")
        status = next(n for n in frame.body if n.target.id == "status")
        self.assertEqual(self.words_of(status.annotation), pydimple._core.words_of_status())
        self.assertEqual([n.target.id for n in frame.body], list(inspect.signature(pydimple.Frame).parameters))

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
            "felt: tuple[float, float, float] = session.follow(depth_mm=0.5, evaluations=8).force_on_tool_N\n"
            "model = pydimple.Organ('brain.nrrd', label=2).build_model(indent_at='left', base=(0, 0, 1), scheme='converging')\n"
            "solved = pydimple.solve(model, contact='frictionless', time='quasi-static', precision='double', preset='none')\n"
            "low = float(solved.band.low_N[-1]) if solved.band else None\n"
            "moment = pydimple.solve(model, accuracy='2%', budget_s=60, quantity='force').moment_on_tool_Nm[-1] @ np.ones(3)\n"
        )
        checked = subprocess.run(
            ["mypy", "--python-executable", sys.executable, "--strict", str(user)], stdout=subprocess.PIPE, text=True
        )
        self.assertEqual(checked.returncode, 0, checked.stdout)
        user.write_text(
            "import pydimple\npydimple.run('brain.nrrd', mu=210)\npydimple.run('brain.nrrd').force\n"
            "pydimple.run('brain.nrrd', contact='sticky')\npydimple.run('brain.nrrd', base='superor')\n"
            "pydimple.Organ('brain.nrrd').build_model(label=2)\n"
        )
        checked = subprocess.run(
            ["mypy", "--python-executable", sys.executable, str(user)], stdout=subprocess.PIPE, text=True
        )
        self.assertEqual(checked.stdout.count("error:"), 5, checked.stdout)


class Documentation(InAFolder):
    def test_every_public_name_is_documented(self):
        for name in pydimple.__all__:
            thing = getattr(pydimple, name)
            self.assertTrue(thing.__doc__, name)
            if inspect.isclass(thing) and not issubclass(thing, BaseException):
                for attribute in (a for a in dir(thing) if not a.startswith("_")):
                    self.assertTrue(getattr(thing, attribute).__doc__, f"{name}.{attribute}")
        self.assertIn("mu_Pa : float, default 210.0\n    shear modulus", pydimple.solve.__doc__)

    def test_the_guides_code_runs(self):
        text = (SOURCE / "apps" / "guide" / "how-to" / "python.md").read_text()
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
