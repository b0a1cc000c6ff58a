#!/usr/bin/env bash
# OpenUSD 26.11 (usd-core): a Gaussian field has no bounds of its own, and is of degree 3 unless it says otherwise.
#
# Expected: other Boundable prims that are made of points (Mesh, Points, curves) get their bounds computed where no
#   `extent` is authored. A field that stores one coefficient a Gaussian is of degree 0.
# Seen: no extent is computed for ParticleField3DGaussianSplat: ComputeExtentFromPlugins() gives None and
#   BBoxCache the empty box, without a word. The fallback of radiance:sphericalHarmonicsDegree is 3, so a field
#   that authors colours alone claims 16 coefficients a Gaussian, and no validator of usd-core objects.
# Output: None; empty; 3 with 2 coefficients for 2 Gaussians; no errors from any of the validators.
# Matters: without an authored extent (with room for three sigmas) cameras frame nothing and culling drops the
#   body; without an authored degree a reader that trusts the schema reads past the coefficients.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check usd-core==26.11
venv/bin/python - <<'PY'
import sys

from pxr import Gf, Usd, UsdGeom, UsdValidation, UsdVol


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


stage = Usd.Stage.CreateInMemory()
UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
UsdGeom.SetStageMetersPerUnit(stage, 1)
places = [Gf.Vec3f(0, 0, 0), Gf.Vec3f(1, 2, 3)]
field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/Field")
field.CreatePositionsAttr(places)
field.CreateOrientationsAttr([Gf.Quatf(1)] * 2)
field.CreateScalesAttr([Gf.Vec3f(0.1, 0.2, 0.3)] * 2)
field.CreateOpacitiesAttr([1, 1])
field.CreateRadianceSphericalHarmonicsCoefficientsAttr([Gf.Vec3f(1, 0, 0)] * 2)
stage.SetDefaultPrim(field.GetPrim())
points = UsdGeom.Points.Define(stage, "/Points")
points.CreatePointsAttr(places)


def extent(prim):
    return UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), Usd.TimeCode.Default())


def empty_box(prim):
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    return cache.ComputeWorldBound(prim).GetRange().IsEmpty()


check("Points: extent", [tuple(v) for v in extent(points)], [(0, 0, 0), (1, 2, 3)])
check("Points: box is empty", empty_box(points.GetPrim()), False)
check("field: extent", extent(field), None)
check("field: box is empty", empty_box(field.GetPrim()), True)
check("field: degree", field.GetRadianceSphericalHarmonicsDegreeAttr().Get(), 3)
check("field: coefficients", len(field.GetRadianceSphericalHarmonicsCoefficientsAttr().Get()), 2)
validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
errors = UsdValidation.ValidationContext(validators).Validate(stage)
check("errors of all validators", [e.GetMessage() for e in errors], [])
print("validators that ran:", len(validators))
PY
