#!/usr/bin/env bash
# OpenUSD 26.11 (usd-core): UsdSkel.BakeSkinning() on a Gaussian field answers True, and leaves it unposed.
#
# Expected: a prim with UsdSkelBindingAPI below a SkelRoot is deformed by its skeleton, and BakeSkinning() returns
#   whether all was baked. ParticleField3DGaussianSplat takes the API and the primvars like any other prim, and the
#   cache counts it among the binding's skinning targets.
# Seen: `points` of a Points prim are posed; `positions` and `orientations` of the field beside it, bound alike, stay,
#   without an error or a warning; the answer is True for both.
# Output: bone turned by 90 degrees about z and raised by 5: Points (0, 5, 0) (0, 6, 0), the field (0, 0, 0) (1, 0,
#   0).
# Matters: animatable Gaussians can be bound in USD and look bound in every tool; the pose must be written as time
#   samples of positions, orientations and coefficients.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check usd-core==26.11
venv/bin/python - <<'PY'
import sys

from pxr import Gf, Usd, UsdGeom, UsdSkel, UsdVol


def check(what, seen, stated):
    print(f"{what}: {seen}")
    if seen != stated:
        sys.exit(f"changed: {what} was {stated}")


def rounded(values):
    return [tuple(round(x, 4) + 0.0 for x in v) for v in values]


stage = Usd.Stage.CreateInMemory()
root = UsdSkel.Root.Define(stage, "/Body")
skeleton = UsdSkel.Skeleton.Define(stage, "/Body/Skeleton")
skeleton.CreateJointsAttr(["hips"])
skeleton.CreateBindTransformsAttr([Gf.Matrix4d(1)])
skeleton.CreateRestTransformsAttr([Gf.Matrix4d(1)])
motion = UsdSkel.Animation.Define(stage, "/Body/Motion")
motion.CreateJointsAttr(["hips"])
motion.CreateTranslationsAttr().Set([Gf.Vec3f(0, 5, 0)], 1)
motion.CreateRotationsAttr().Set([Gf.Quatf(0.5**0.5, 0, 0, 0.5**0.5)], 1)
motion.CreateScalesAttr().Set([Gf.Vec3h(1)], 1)
UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(["/Body/Motion"])


def bind(prim):
    binding = UsdSkel.BindingAPI.Apply(prim)
    binding.CreateSkeletonRel().SetTargets(["/Body/Skeleton"])
    binding.CreateJointIndicesPrimvar(False, 1).Set([0, 0])
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.0, 1.0])


rest = [Gf.Vec3f(0, 0, 0), Gf.Vec3f(1, 0, 0)]
points = UsdGeom.Points.Define(stage, "/Body/Points")
points.CreatePointsAttr(rest)
bind(points.GetPrim())
field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/Body/Field")
field.CreatePositionsAttr(rest)
field.CreateOrientationsAttr([Gf.Quatf(1)] * 2)
field.CreateScalesAttr([Gf.Vec3f(0.1, 0.2, 0.3)] * 2)
field.CreateOpacitiesAttr([1, 1])
bind(field.GetPrim())

cache = UsdSkel.Cache()
cache.Populate(root, Usd.PrimDefaultPredicate)
targets = [str(t.GetPrim().GetPath())
           for b in cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate) for t in b.GetSkinningTargets()]
check("skinning targets", sorted(targets), ["/Body/Field", "/Body/Points"])
check("BakeSkinning", UsdSkel.BakeSkinning(root, Gf.Interval(1, 1)), True)
check("Points", rounded(points.GetPointsAttr().Get(1)), [(0, 5, 0), (0, 6, 0)])
check("field's positions", rounded(field.GetPositionsAttr().Get(1)), [(0, 0, 0), (1, 0, 0)])
check("field's orientations", [q.GetReal() for q in field.GetOrientationsAttr().Get(1)], [1.0, 1.0])
PY
