// SPDX-License-Identifier: Apache-2.0
/// @file  Runs the program in docs/captures.md that converts pickled bodies, on files in the form of published ones.
#include "io/small_body.hpp"
#include "io/temporary.hpp"
#include "support/skip.hpp"

#include <gsh/io/body/body_file.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <string>

using namespace gsh;

namespace {

/// Pickles the arrays of BODY.npz in the form of published files: by Python 2, whose strings are bytes, with a sparse
/// regressor, chumpy's arrays, unsigned indices, and members that are not arrays. The classes of chumpy and SciPy are
/// replaced by empty ones, because a pickle stores only their names and attributes.
constexpr const char* maker = R"python(
import pickle, struct, sys, types, numpy as np

def made_up(module, name):
    parts = module.split(".")
    for k in range(len(parts)):
        sys.modules.setdefault(".".join(parts[:k + 1]), types.ModuleType(parts[k]))
    new = type(name, (object,), {"__module__": module})
    setattr(sys.modules[module], name, new)
    return new

def instance(of, **attributes):
    made = of()
    made.__dict__.update(attributes)
    return made

Ch = made_up("chumpy.ch", "Ch")
Select = made_up("chumpy.reordering", "Select")
csc_matrix = made_up("scipy.sparse.csc", "csc_matrix")

def ch(array):
    return instance(Ch, x=array, _dirty_vars=set(), _itr=None, _depends_on_deps={})

def sparse(array):
    columns, rows = np.nonzero(array.T)
    indptr = np.searchsorted(columns, np.arange(array.shape[1] + 1)).astype(np.int32)
    return instance(csc_matrix, _shape=array.shape, maxprint=50, data=array[rows, columns], indptr=indptr,
                    indices=rows.astype(np.int32))

class Python2Pickler(pickle._Pickler):
    dispatch = dict(pickle._Pickler.dispatch)

    def save_string(self, value):
        value = value if isinstance(value, bytes) else value.encode("latin1")
        self.write(b"T" + struct.pack("<i", len(value)) + value)
    dispatch[bytes] = dispatch[str] = save_string

    def save_global(self, obj, name=None):
        module = obj.__module__.replace("numpy._core", "numpy.core")
        module = {"copyreg": "copy_reg", "builtins": "__builtin__"}.get(module, module)
        self.write(b"c" + module.encode() + b"\n" + (name or obj.__qualname__).encode() + b"\n")
        self.memoize(obj)
    dispatch[types.FunctionType] = dispatch[types.BuiltinFunctionType] = dispatch[type] = save_global

kind, source, target = sys.argv[1:]
body = {k: v for k, v in np.load(source).items() if k not in ("num_betas", "num_expressions")}
parents = body["kintree_table"].copy()
body["f"] = body["f"].astype(np.uint32)
if kind == "smpl":
    parents[0, 0] = 2**32 - 1
    body["kintree_table"] = parents.astype(np.uint32)
    body["J_regressor"] = sparse(body["J_regressor"])
    shapedirs = body["shapedirs"]
    more = np.concatenate([shapedirs, np.ones(shapedirs.shape[:2] + (2,))], axis=2)  # of which the first are chosen
    chosen = np.arange(more.size).reshape(more.shape)[:, :, :shapedirs.shape[2]]
    body["shapedirs"] = instance(Select, a=ch(more), idxs=chosen.ravel(), preferred_shape=shapedirs.shape)
    body["v_template"] = ch(body["v_template"])
    body["weights"] = ch(body["weights"])
    body.update(bs_type="lrotmin", bs_style="lbs", J=ch(np.zeros((24, 3))), weights_prior=sparse(np.eye(3)))
if kind == "smplh":
    body["kintree_table"] = parents.astype(np.int64)
    body["posedirs"] = np.asfortranarray(body["posedirs"])
if kind == "smplx":
    body["kintree_table"] = parents.astype(np.int64)
    body.update(part2num={"head": 0}, joint2num={"pelvis": 0}, allow_pickle=True)
with open(target, "wb") as file:
    Python2Pickler(file, protocol=2).dump(body)
)python";

/// The page's block of Python that defines an unpickler.
std::string recipe() {
    const std::string page = read_file(std::filesystem::path(GSH_SOURCE_DIR) / "docs/captures.md");
    const std::string fence = "```python\n";
    for (std::size_t at = page.find(fence); at != std::string::npos; at = page.find(fence, at + 1)) {
        const std::size_t begin = at + fence.size(), end = page.find("```", begin);
        const std::string block = page.substr(begin, end - begin);
        if (block.find("pickle.Unpickler") != std::string::npos) return block;
    }
    return {};
}

/// Runs a command and writes its output to a file. Returns true if it succeeded.
bool shell(const std::string& command, const std::filesystem::path& output) {
    return std::system((command + " >'" + output.string() + "' 2>&1").c_str()) == 0;
}

/// The command of a Python with NumPy, or nothing if there is none.
std::string python_with_numpy(const std::filesystem::path& output) {
    for (const char* python : {"python3", "/usr/bin/python3"})
        if (shell(std::string(python) + " -c 'import numpy'", output)) return python;
    return {};
}

} // namespace

TEST_CASE("the page's program converts pickled bodies of SMPL, SMPL-H and SMPL-X, number for number") {
    const test::Temporary folder;
    const std::filesystem::path said = folder / "said.txt";
    const std::string python = python_with_numpy(said);
    if (python.empty()) {
        test::skip("there is no python3 with NumPy");
        return;
    }
    REQUIRE(!recipe().empty());
    write_file(folder / "recipe.py", recipe());
    write_file(folder / "maker.py", maker);
    struct Kind {
        const char* name;
        std::size_t joints;
        int shapes, expressions;
    };
    for (const Kind& kind : {Kind{"smpl", 24, 10, 0}, Kind{"smplh", 52, 16, 0}, Kind{"smplx", 55, 10, 10}}) {
        CAPTURE(kind.name);
        BodyModel body = test::small_body(kind.joints, kind.shapes, kind.expressions, kind.joints > 24);
        test::Rng rng(9);
        body.posedirs = rng.vecs(body.vertex_count() * body.pose_feature_count(), -0.01, 0.01);
        save_body_model(folder / "body.npz", body);
        const auto file = [&](const char* name) { return " '" + (folder / name).string() + "'"; };
        for (const std::string& command :
             {python + file("maker.py") + " " + kind.name + file("body.npz") + file("body.pkl"),
              python + file("recipe.py") + file("body.pkl") + file("converted.npz")}) {
            const bool done = shell(command, said);
            INFO(read_file(said));
            REQUIRE(done);
        }
        const BodyModel found = load_body_model(folder / "converted.npz");
        CHECK((found.v_template == body.v_template));
        CHECK(found.shape_count == body.shape_count);
        CHECK(found.expression_count == body.expression_count);
        CHECK((found.shapedirs == body.shapedirs));
        CHECK((found.exprdirs == body.exprdirs));
        CHECK((found.posedirs == body.posedirs));
        CHECK((found.weights == body.weights));
        CHECK((found.parents == body.parents));
        CHECK((found.faces == body.faces));
        CHECK((found.hands_mean_left == body.hands_mean_left));
        CHECK((found.hands_mean_right == body.hands_mean_right));
        CHECK((found.hands_components_left == body.hands_components_left));
        CHECK((found.hands_components_right == body.hands_components_right));
        REQUIRE(found.J_regressor.size() == body.J_regressor.size());
        for (std::size_t j = 0; j < body.J_regressor.size(); ++j) {
            REQUIRE(found.J_regressor[j].size() == body.J_regressor[j].size());
            for (std::size_t k = 0; k < body.J_regressor[j].size(); ++k) {
                CHECK(found.J_regressor[j][k].vertex == body.J_regressor[j][k].vertex);
                CHECK(found.J_regressor[j][k].weight == body.J_regressor[j][k].weight);
            }
        }
    }
}
