// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/body_file.hpp>

#include "io/npz_files.hpp"
#include "io/small_body.hpp"
#include "io/temporary.hpp"

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// A body file. Tests may leave out or replace members.
class BodyParts {
public:
    static constexpr std::size_t V = 6, J = 3, C = 4;
    using Add = std::function<void(NpzWriter&, const std::string&)>;

    template <class T>
    void set(const std::string& key, std::vector<T> data, Shape shape) {
        members_[key] = [data = std::move(data), shape](NpzWriter& file, const std::string& name) {
            file.add(name, data, shape);
        };
    }
    void set_text(const std::string& key, const std::string& text) {
        members_[key] = [text](NpzWriter& file, const std::string& name) { file.add_text(name, text); };
    }
    void remove(const std::string& key) { REQUIRE(members_.erase(key) == 1); }
    void write(const std::filesystem::path& path) const {
        NpzWriter file(path);
        for (const auto& [key, add] : members_) add(file, key);
        file.commit();
    }

private:
    std::map<std::string, Add> members_;
};

BodyParts valid_parts() {
    constexpr auto V = BodyParts::V, J = BodyParts::J, C = BodyParts::C;
    BodyParts parts;
    std::vector<double> vertices(3 * V), weights(V * J, 0), regressor(J * V, 0), dirs(V * 3 * C);
    for (std::size_t i = 0; i < vertices.size(); ++i) vertices[i] = 0.1 * static_cast<double>(i);
    for (std::size_t i = 0; i < dirs.size(); ++i) dirs[i] = 0.01 * static_cast<double>(i);
    for (std::size_t v = 0; v < V; ++v) weights[v * J + v % J] = 1;
    for (std::size_t j = 0; j < J; ++j) regressor[j * V + 2 * j] = 0.25, regressor[j * V + 2 * j + 1] = 0.75;
    parts.set("v_template", std::vector<float>(vertices.begin(), vertices.end()), {V, 3});
    parts.set<std::uint32_t>("f", {0, 1, 2, 3, 4, 5}, {2, 3});
    parts.set("shapedirs", dirs, {V, 3, C});
    parts.set("weights", weights, {V, J});
    parts.set("J_regressor", regressor, {J, V});
    parts.set<std::uint32_t>("kintree_table", {4294967295u, 0, 0, 0, 1, 2}, {2, J});
    return parts;
}

void check_equal(const BodyModel& a, const BodyModel& b) {
    CHECK(a.v_template == b.v_template);
    CHECK(a.shapedirs == b.shapedirs);
    CHECK(a.exprdirs == b.exprdirs);
    CHECK(a.posedirs == b.posedirs);
    CHECK(a.weights == b.weights);
    CHECK(a.parents == b.parents);
    CHECK(a.faces == b.faces);
    CHECK(a.shape_count == b.shape_count);
    CHECK(a.expression_count == b.expression_count);
    CHECK(a.vt == b.vt);
    CHECK(a.ft == b.ft);
    CHECK(a.joint_names == b.joint_names);
    CHECK(a.hands_mean_left == b.hands_mean_left);
    CHECK(a.hands_mean_right == b.hands_mean_right);
    CHECK(a.hands_components_left == b.hands_components_left);
    CHECK(a.hands_components_right == b.hands_components_right);
    CHECK(a.face_vertices == b.face_vertices);
    CHECK(a.left_hand_vertices == b.left_hand_vertices);
    CHECK(a.right_hand_vertices == b.right_hand_vertices);
    REQUIRE(a.J_regressor.size() == b.J_regressor.size());
    for (std::size_t j = 0; j < a.J_regressor.size(); ++j) {
        REQUIRE(a.J_regressor[j].size() == b.J_regressor[j].size());
        for (std::size_t k = 0; k < a.J_regressor[j].size(); ++k) {
            CHECK(a.J_regressor[j][k].vertex == b.J_regressor[j][k].vertex);
            CHECK(a.J_regressor[j][k].weight == b.J_regressor[j][k].weight);
        }
    }
}

} // namespace

TEST_CASE("a body comes back as it was saved") {
    const test::Temporary folder;
    BodyModel model = test::small_body(5, 3, 2, true);
    test::Rng rng(2);
    model.posedirs = rng.vecs(model.vertex_count() * model.pose_feature_count());
    model.vt = {{0, 0}, {1, 0}, {0.5, 1}};
    model.ft.assign(model.faces.size(), {0, 1, 2});
    model.joint_names = {"pelvis", "a", "b", "c", "d"};
    model.face_vertices = {1, 3};
    model.left_hand_vertices = {0};
    model.right_hand_vertices = {4, 2};
    save_body_model(folder / "a.npz", model);
    check_equal(load_body_model(folder / "a.npz"), model);

    const BodyModel bare = test::small_body(2, 0, 0);
    save_body_model(folder / "b.npz", bare);
    check_equal(load_body_model(folder / "b.npz"), bare);
    model.weights[0] += 0.1;
    CHECK_THROWS_AS(save_body_model(folder / "c.npz", model), ValueError);
    CHECK(!std::filesystem::exists(folder / "c.npz"));
}

TEST_CASE("directions are cut into shape and expression") {
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    BodyParts parts = valid_parts();
    const auto counts = [&] {
        parts.write(path);
        const BodyModel model = load_body_model(path);
        return std::pair(model.shape_count, model.expression_count);
    };
    CHECK(counts() == std::pair(4, 0));
    parts.set<std::int64_t>("num_betas", {3}, {});
    CHECK(counts() == std::pair(3, 1));
    parts.set<std::int64_t>("num_expressions", {1}, {1});
    CHECK(counts() == std::pair(3, 1));
    const BodyModel model = load_body_model(path);
    CHECK(model.shapedirs[1 * 3 + 2].y == doctest::Approx(0.01 * (1 * 12 + 1 * 4 + 2)));
    CHECK(model.exprdirs[1].z == doctest::Approx(0.01 * (1 * 12 + 2 * 4 + 3)));
    parts.set<std::int64_t>("num_expressions", {2}, {});
    test::check_throws<ValueError>(counts, {path.string(), "num_betas", "add up"});
    parts.set<std::int64_t>("num_betas", {9}, {});
    test::check_throws<ValueError>(counts, {path.string(), "num_betas", "9"});
    parts.set<std::int64_t>("num_betas", {1, 2}, {2});
    test::check_throws<ShapeError>(counts, {path.string(), "num_betas", "single number"});
    parts.remove("num_betas");
    CHECK(counts() == std::pair(2, 2));
}

TEST_CASE("the rule of SMPL-X where the file does not say") {
    const test::Temporary folder;
    for (const auto& [found, shape] : {std::pair{400, 300}, {20, 10}, {10, 10}, {16, 16}}) {
        BodyModel model = test::small_body(55, found, 0);
        save_body_model(folder / "all.npz", model);
        const NpzReader all(folder / "all.npz");
        NpzWriter file(folder / "a.npz");
        for (const char* key : {"v_template", "shapedirs", "weights", "J_regressor"}) {
            const auto array = all.read<double>(key);
            file.add(key, array.data, array.shape);
        }
        for (const char* key : {"f", "kintree_table"}) {
            const auto array = all.read<int>(key);
            file.add(key, array.data, array.shape);
        }
        file.commit();
        model = load_body_model(folder / "a.npz");
        CHECK(model.shape_count == shape);
        CHECK(model.expression_count == found - shape);
    }
}

TEST_CASE("pickled members are skipped unless they are needed") {
    constexpr auto V = BodyParts::V;
    const test::Temporary folder;
    valid_parts().write(folder / "a.npz");
    const NpzReader good(folder / "a.npz");
    const auto write = [&](const std::string& pickled) {
        test::ZipFile zip(folder / "b.npz");
        const auto raw = [](const auto& array) {
            return std::string(reinterpret_cast<const char*>(array.data.data()),
                               array.data.size() * sizeof(array.data[0]));
        };
        for (const auto& key : good.keys())
            if (key != pickled) {
                const NpyHeader header = good.header(key);
                std::string shape = detail::shape_text(header.shape);
                if (header.is_real())
                    zip.add(key + ".npy", test::npy_bytes("<f8", shape, raw(good.read<double>(key))), true);
                else
                    zip.add(key + ".npy", test::npy_bytes("<i8", shape, raw(good.read<std::int64_t>(key))), true);
            }
        zip.add(pickled + ".npy", test::npy_bytes("|O", "()", "\x80\x04N."), true);
    };
    for (const char* key : {"part2num", "posedirs", "hands_meanl", "vt", "joint_names", "face_vertices", "num_betas"}) {
        write(key);
        CHECK(load_body_model(folder / "b.npz").vertex_count() == V);
    }
    for (const char* key : {"v_template", "f", "weights", "J_regressor", "shapedirs", "kintree_table"}) {
        write(key);
        test::check_throws<IoError>([&] { (void)load_body_model(folder / "b.npz"); }, {"b.npz", key, "pickled"});
    }
}

TEST_CASE("every missing or misshapen member is named") {
    constexpr auto V = BodyParts::V;
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    const auto load = [&] { (void)load_body_model(path); };
    for (const char* key : {"v_template", "f", "weights", "J_regressor", "shapedirs", "kintree_table"}) {
        BodyParts parts = valid_parts();
        parts.remove(key);
        parts.write(path);
        test::check_throws<IoError>(load, {path.string(), std::string(key) + " is missing"});
        parts.set_text(key, "text");
        parts.write(path);
        test::check_throws<IoError>(load, {path.string(), key, "dtype <U4"});
        parts.set<double>(key, std::vector<double>(16, 0.0), {2, 2, 2, 2});
        if (std::string(key) == "f" || std::string(key) == "kintree_table")
            parts.set<int>(key, std::vector<int>(16, 0), {2, 2, 2, 2});
        parts.write(path);
        test::check_throws<ShapeError>(load, {path.string(), key, "(2, 2, 2, 2)"});
    }
    const std::map<std::string, Shape> wrong{
        {"posedirs", {V, 3, 5}}, {"hands_meanl", {44}}, {"hands_componentsr", {45, 44}}};
    for (const auto& [key, shape] : wrong) {
        BodyParts parts = valid_parts();
        parts.set(key, std::vector<double>(detail::element_count(shape)), shape);
        parts.write(path);
        test::check_throws<ShapeError>(load, {path.string(), key, detail::shape_text(shape)});
    }
    BodyParts parts = valid_parts();
    parts.set<double>("face_vertices", {1, 2}, {2});
    parts.write(path);
    test::check_throws<IoError>(load, {path.string(), "face_vertices", "<f8"});
    parts.set<int>("face_vertices", {1, 6}, {2});
    parts.write(path);
    test::check_throws<ValueError>(load, {path.string(), "face_vertices[1] is 6"});
    valid_parts().write(path);
    test::truncate_file(path, 200);
    test::check_throws<IoError>(load, {path.string(), "truncated"});
    std::filesystem::remove(path);
    test::check_throws<IoError>(load, {path.string(), "No such file"});
}

TEST_CASE("arrays that are no body") {
    constexpr auto V = BodyParts::V, J = BodyParts::J, C = BodyParts::C;
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    const auto expect = [&](const auto& change, std::initializer_list<std::string_view> words) {
        BodyParts parts = valid_parts();
        change(parts);
        parts.write(path);
        test::check_throws<ValueError>([&] { (void)load_body_model(path); }, {path.string()});
        test::check_throws<ValueError>([&] { (void)load_body_model(path); }, words);
    };
    std::vector<double> weights(V * J, 1.0 / 3);
    weights[4] = 0.5;
    expect([&](BodyParts& parts) { parts.set("weights", weights, {V, J}); },
           {"weights of vertex 1", "sum to 1.16", "expected 1"});
    expect([&](BodyParts& parts) { parts.set("J_regressor", std::vector<double>(J * V, 0.5), {J, V}); },
           {"J_regressor row 0", "expected 1"});
    const auto tree = [&](const std::vector<std::int64_t>& rows, std::initializer_list<std::string_view> words) {
        expect([&](BodyParts& parts) { parts.set("kintree_table", rows, {2, J}); }, words);
    };
    tree({-1, 2, 1, 0, 1, 2}, {"joint 1", "cycle"});
    tree({-1, 2, 0, 0, 1, 2}, {"joint 1", "before its parent"});
    tree({-1, -1, 0, 0, 1, 2}, {"joint 1", "second root"});
    tree({-1, 0, 7, 0, 1, 2}, {"kintree_table", "[0, 2] is 7"});
    tree({-1, 0, 1, 0, 2, 1}, {"kintree_table", "[1, 1] is 2"});
    expect([&](BodyParts& parts) { parts.set<int>("f", {0, 1, 6}, {1, 3}); }, {"f[2] is 6"});
    expect([&](BodyParts& parts) { parts.set<int>("f", {0, -1, 2}, {1, 3}); }, {"f[1] is -1"});
    for (const auto& [key, shape] : std::map<std::string, Shape>{{"v_template", {V, 3}},
                                                                 {"weights", {V, J}},
                                                                 {"J_regressor", {J, V}},
                                                                 {"shapedirs", {V, 3, C}},
                                                                 {"hands_meanl", {45}}}) {
        std::vector<float> data(detail::element_count(shape));
        data.back() = std::numeric_limits<float>::quiet_NaN();
        expect([&, &k = key, &s = shape](BodyParts& parts) { parts.set(k, data, s); }, {key, "NaN"});
    }
}
