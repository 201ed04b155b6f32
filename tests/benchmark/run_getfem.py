"""Computes a scene with GetFEM and prints the forces.

    python3 tests/benchmark/run_getfem.py SCENE NODES     (apt install python3-getfem python3-numpy)

Hexahedra with quadratic displacement and linear pressure; contact without friction by an augmented Lagrangian with a multiplier on the
surface, so that nothing is penalised; Newton, MUMPS, from one depth to the next along the line through the last two.
"""

import numpy as np
from hexahedra import edge_for, mesh, refined_radius
from runner import CannotRun, main

VERSION = "5.4.2"   # of Debian 12; the module does not report its own
LARGEST_STEP = 0.25  # mm
ORDER, AT_CONTACT = 5, 13  # of the integration: contact begins and ends within a face
BASE, CONTACT, TOP, PATCH = 1, 2, 3, 4  # regions


class Body:
    """Unknowns and energies of a body whose top is at z = height; `edge` is the edge length in the contact."""

    def __init__(self, getfem, mesh, scene, edge):
        getfem.util_trace_level(0)
        getfem.util_warning_level(0)
        self.getfem, self.scene, self.height = getfem, scene, scene["body"]["height_mm"]
        self.regions(mesh)
        quadratic, linear, on_surface = getfem.MeshFem(mesh, 3), getfem.MeshFem(mesh, 1), getfem.MeshFem(mesh, 1)
        quadratic.set_classical_fem(2)
        linear.set_classical_fem(1)
        on_surface.set_classical_fem(1)
        self.mesh, self.points = mesh, getfem.MeshIm(mesh, ORDER)
        self.nodes = quadratic.nbdof() // 3
        model = self.model = getfem.Model("real")
        model.add_fem_variable("u", quadratic)
        model.add_fem_variable("p", linear)
        self.names = "up"
        mu, nu = 1e-6 * scene["mu_Pa"], scene["nu"]
        for name, value in {"mu": mu, "bulk": 2 * mu * (1 + nu) / (3 * (1 - 2 * nu)), "weight": 0.0,
                            "film": 1e-3 * scene["film_N_per_m"]}.items():
            model.add_initialized_data(name, [value])
        model.add_macro("F", "(Id(3)+Grad_u)")
        model.add_nonlinear_term(self.points, "mu/2*(pow(Det(F),-2/3)*Norm_sqr(F)-3)+p*(Det(F)-1)-sqr(p)/(2*bulk)+weight*u(3)")
        model.add_Dirichlet_condition_with_simplification("u", BASE)
        if scene["film_N_per_m"]:  # incompressible membrane, in the plane of the top
            model.add_macro("A", "(F*[1;0;0])")
            model.add_macro("B", "(F*[0;1;0])")
            model.add_nonlinear_term(
                self.points, "film/2*(Norm_sqr(A)+Norm_sqr(B)+1/(Norm_sqr(A)*Norm_sqr(B)-sqr(A.B))-3)", TOP)
        if scene["tool"]["shape"] == "disc":
            model.add_initialized_data("move", [0.0, 0.0, 0.0])
            model.add_Dirichlet_condition_with_simplification("u", PATCH, "move")
        else:
            self.add_contact(on_surface, mu, edge)

    def regions(self, mesh):
        place, faces = mesh.pts(), mesh.outer_faces()
        corners = [place[:, mesh.pid_in_faces(faces[:, [k]])] for k in range(faces.shape[1])]
        low, high = (np.array([f(c[2]) for c in corners]) for f in (np.min, np.max))
        away = np.array([np.hypot(c[0], c[1]).max() for c in corners])
        top = low > self.height - 1e-6
        for region, chosen in ((BASE, high < 1e-6), (TOP, top), (CONTACT, top & (away < refined_radius(self.scene) + 1e-6)),
                               (PATCH, top & (away < self.scene["tool"]["radius_mm"] + 1e-6))):
            mesh.set_region(region, faces[:, chosen])

    def add_contact(self, on_surface, mu, edge):
        """A sphere is a punch without a flat. Above the rounding of its edge the flank is vertical."""
        self.at_contact = self.getfem.MeshIm(self.mesh, AT_CONTACT)
        tool, model = self.scene["tool"], self.model
        self.bend = tool.get("edge_mm", tool["radius_mm"])
        model.add_filtered_fem_variable("l", on_surface, CONTACT)
        self.names = "upl"
        for name, value in {"bend": self.bend, "flat": tool["radius_mm"] - self.bend, "at": 2 * self.height, "r": 20 * mu / edge}.items():
            model.add_initialized_data(name, [value])
        away = "sqr(X(1)+u(1))+sqr(X(2)+u(2))"
        model.add_macro("dist", f"sqrt({f'2*half_sqr_pos_part(sqrt({away}+1e-12)-flat)' if tool['radius_mm'] > self.bend else away}"
                                "+2*half_sqr_pos_part(at-X(3)-u(3)))")
        model.add_nonlinear_term(self.at_contact, "1/r*(half_sqr_neg_part(l+r*(dist-bend))-sqr(l)/2)", CONTACT)

    def solve(self):
        found = self.model.solve("max_iter", 40, "max_res", 1e-7, "lsearch", "simplest", "alpha min", 0.3, "lsolver", "mumps")
        if not found[1]:
            raise CannotRun("Newton's iteration finds no equilibrium")

    def sag(self):
        """Equilibrium under the weight; returns how far the middle of the top sinks."""
        weight = 1e-9 * self.scene["density_kg_per_m3"] * self.scene["gravity_m_per_s2"]  # N/mm3
        for fraction in (0.25, 0.5, 0.75, 1.0) if weight else ():
            self.model.set_variable("weight", [fraction * weight])
            self.solve()
        return -float(np.ravel(self.model.interpolation("u", [[0.0], [0.0], [self.height - 1e-6]], self.mesh))[2]) if weight else 0.0

    def force(self):
        if self.names != "up":
            vertical = "neg_part(l+r*(dist-bend))*pos_part(at-X(3)-u(3))/dist"
            return self.getfem.asm_generic(self.at_contact, 0, vertical, CONTACT, self.model)
        # Of the base: work of the stress on a displacement of 1 there and of 0 at the top.
        stress = "(mu*pow(Det(F),-2/3)*(F-Norm_sqr(F)/3*Inv(F)')+p*Det(F)*Inv(F)')"
        return self.getfem.asm_generic(self.points, 0, f"-({stress}*[0;0;1]).[0;0;1]/{self.height}", -1, self.model)

    def forces(self, depths):
        top, result, states, before = self.height - self.sag(), [], [], 0.0
        for depth in depths:
            steps = int(np.ceil((depth - before) / LARGEST_STEP - 1e-9))
            for at in np.linspace(before, depth, steps + 1)[1:]:
                if self.names == "up":
                    self.model.set_variable("move", [0.0, 0.0, -at])
                else:
                    self.model.set_variable("at", [top + self.bend - at])
                if len(states) > 1:
                    for name, last, earlier in zip(self.names, states[-1], states[-2]):
                        self.model.set_variable(name, 2 * last - earlier)
                self.solve()
                states = [*states[-1:], [self.model.variable(name).copy() for name in self.names]]
            before = depth
            result.append(self.force())
        return result


def mesh_in(getfem, elements):
    made = getfem.Mesh("empty", 3)
    for points in elements:
        made.add_convex(getfem.GeoTrans("GT_QK(3,2)"), points.transpose(2, 1, 0, 3).reshape(27, 3).T)
    return made


def run(_, scene, nodes):
    import getfem

    if scene["friction"]:
        raise CannotRun("this runner has no friction")
    edge = edge_for(nodes, scene, False)
    body = Body(getfem, mesh_in(getfem, mesh(edge, scene)[0]), scene, edge)
    return VERSION, body.nodes, body.forces(scene["depths_mm"])


if __name__ == "__main__":
    main("GetFEM", __doc__, run)
