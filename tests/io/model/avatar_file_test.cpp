// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/setup/avatar_export.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/trainer.hpp>

#include "io/npz_files.hpp"
#include "io/temporary.hpp"
#include "support/bodies.hpp"
#include "support/contains.hpp"
#include "support/small_training.hpp"

#include <unistd.h>
#include <zip.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

AvatarData small_avatar() {
    const BodyModel body = test::tube(4, 6, 6);
    const std::vector<double> betas{0.3, -0.1};
    const auto samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 2.0), 3);
    AvatarData avatar{make_rig(body, betas, samples), GaussianCloud<float>(samples.size(), 2), ColorClamp::below};
    test::Rng rng(6);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        avatar.gaussians.means[i] = vec3<float>(samples.positions[i]);
        avatar.gaussians.log_scales[i] = vec3<float>(rng.vec(-4, -3));
        avatar.gaussians.opacity_logits[i] = static_cast<float>(rng.uniform(-1, 1));
    }
    for (auto& value : avatar.gaussians.sh) value = vec3<float>(rng.vec());
    return avatar;
}

std::filesystem::path temporary(const char* name) {
    return std::filesystem::temp_directory_path() / ("gsh-avatar-" + std::to_string(getpid()) + "-" + name);
}

template <class F>
std::string message_of(const F& work) {
    try {
        work();
    } catch (const Error& error) {
        return error.what();
    }
    return {};
}

/// Replaces a member's bytes. Without bytes, removes the member.
void replace_member(const std::filesystem::path& path, const std::string& member, const std::string& bytes) {
    int error = 0;
    zip_t* archive = zip_open(path.c_str(), 0, &error);
    REQUIRE(archive != nullptr);
    const zip_int64_t index = zip_name_locate(archive, member.c_str(), 0);
    REQUIRE(index >= 0);
    if (bytes.empty())
        CHECK(zip_delete(archive, static_cast<zip_uint64_t>(index)) == 0);
    else
        CHECK(zip_file_replace(archive, static_cast<zip_uint64_t>(index),
                               zip_source_buffer(archive, bytes.data(), bytes.size(), 0), 0) == 0);
    CHECK(zip_close(archive) == 0);
}

using Model = test::SmallAvatar<cpu::Serial>;

/// A few steps of training, the last of them past the start of ambient occlusion.
struct ShadedTraining {
    test::SmallScene scene;
    cpu::Serial backend;
    SurfaceSamples samples = sample_surface(scene.body, shaped_vertices(scene.body, scene.betas),
                                            std::vector<double>(scene.body.vertex_count(), 4.0), 3);
    RigData rig = make_rig(scene.body, scene.betas, samples);
    Model model;
    AvatarScene<cpu::Serial, Model> people;
    Trainer<cpu::Serial, AvatarScene<cpu::Serial, Model>> trainer;

    explicit ShadedTraining(const std::string& ao, int hidden_layers = 2, double normal_rate = 0,
                            const std::optional<LightData>& light = {})
        : model(make_avatar<cpu::Serial, AvatarParts, float, 4, 2, 1>(
              backend, rig, samples, scene.motion.frame_count(), 3,
              {.appearance = {.field = {.grid = {.base = 4, .growth = 2, .table_size = 1024},
                                        .width = 16,
                                        .hidden_layers = hidden_layers}},
               .ao = ao,
               .occlusion = {.grid = {.table_size = 1024}, .width = 16, .largest = 1.2},
               .model = {.normal_offset_rate = normal_rate}},
              {}, test::lit_by(backend, light))),
          people(backend, model, scene.motion), trainer(backend, people, scene.photos, 3) {
        for (int i = 0; i < 12; ++i) trainer.step(0.9);
    }
    AvatarData avatar() {
        return export_avatar(people, rig, photographed_frames(scene.photos), trainer.config().filter);
    }
};

/// Splats of frame 0 of a motion, number after number: show(pose, center, splats) writes them.
template <class B, class Shown>
std::vector<float> splats_of(B& backend, Shown& shown, const Motion& motion, const auto& show) {
    RigPose<B, float> pose;
    shown.rig().upload_pose(motion, 0, pose);
    Splats<B, float> splats;
    splats.resize(shown.size());
    show(pose, vec3<float>(0, 1, 3.5), splats.view());
    backend.synchronize();
    std::vector<float> all;
    const auto add = [&](const auto& values) {
        const std::size_t before = all.size(), bytes = values.size() * sizeof(values[0]);
        all.resize(before + bytes / sizeof(float));
        std::memcpy(all.data() + before, values.data(), bytes);
    };
    add(splats.means), add(splats.covariances), add(splats.opacities), add(splats.colors);
    return all;
}
template <class B>
std::vector<float> splats_of(B& backend, const Avatar<B>& avatar, const Motion& motion) {
    return splats_of(backend, avatar, motion, [&](const auto& pose, const auto& center, const auto& splats) {
        typename Avatar<B>::Cache cache;
        avatar.pose(pose, center, splats, cache);
    });
}
std::vector<float> splats_of(cpu::Serial& backend, Model& model, const Motion& motion) {
    model.update_canonical();
    return splats_of(backend, model, motion, [&](const auto& pose, const auto& center, const auto& splats) {
        model.pose(pose, 0, center, splats);
    });
}

} // namespace

TEST_CASE("an avatar comes back from its file as it was, and poses the same") {
    const AvatarData avatar = small_avatar();
    const auto path = temporary("round.gsh");
    save_avatar(path, avatar);
    const AvatarData back = load_avatar(path);
    CHECK(back.rig.betas == avatar.rig.betas);
    CHECK(back.rig.triangles == avatar.rig.triangles);
    CHECK(back.rig.skin.weights == avatar.rig.skin.weights);
    CHECK(back.gaussians.sh == avatar.gaussians.sh);
    CHECK(back.gaussians.opacity_logits == avatar.gaussians.opacity_logits);
    CHECK(back.clamping == ColorClamp::below);

    cpu::Serial backend;
    Motion motion = rest_motion(avatar.rig);
    test::Rng rng(2);
    motion.pose = rng.vecs(4);
    const auto posed = [&](const AvatarData& data) {
        const Avatar<cpu::Serial> shown(backend, data);
        RigPose<cpu::Serial, float> pose;
        shown.rig().upload_pose(motion, 0, pose);
        Splats<cpu::Serial, float> splats;
        splats.resize(shown.size());
        Avatar<cpu::Serial>::Cache cache;
        shown.pose(pose, {0, 0, 3}, splats.view(), cache);
        return std::vector<vec3<float>>(splats.means.begin(), splats.means.end());
    };
    CHECK(posed(back) == posed(avatar));
    std::filesystem::remove(path);
}

TEST_CASE("an avatar without Gaussians comes back, too") {
    const auto path = temporary("empty.gsh");
    const BodyModel body = test::tube(2, 3, 4);
    AvatarData avatar{
        make_rig(body, {},
                 sample_surface(body, shaped_vertices(body, {}), std::vector<double>(body.vertex_count(), 0.0), 3)),
        GaussianCloud<float>(0, 1)};
    for (const ArrayStorage storage : {ArrayStorage::sparse, ArrayStorage::compact}) {
        save_avatar(path, avatar, storage);
        CHECK(load_avatar(path).gaussians.size() == 0);
    }
    std::filesystem::remove(path);
}

TEST_CASE("shadows that follow the pose come back from a file and fall on a new motion as in training") {
    for (const int hidden_layers : {1, 2}) {
        CAPTURE(hidden_layers);
        ShadedTraining training(AmbientOcclusion::pose, hidden_layers);
        const auto path = temporary("shaded.gsh");
        save_avatar(path, training.avatar());
        const AvatarData data = load_avatar(path);
        REQUIRE(data.occlusion_field);
        CHECK(data.ao.size() == training.model.size()); // the mean, for formats without poses
        CHECK(data.occlusion_field->largest == 1.2);
        const Avatar<cpu::Serial> avatar(training.backend, data);
        cpu::Threads threads(3);
        const Avatar<cpu::Threads> threaded(threads, data);
        AvatarData without = data;
        without.occlusion_field.reset();
        const Avatar<cpu::Serial> meant(training.backend, without);

        Motion motion = training.scene.motion;
        test::Rng rng(4);
        for (int i = 0; i < 3; ++i) {
            if (i) motion.pose = rng.vecs(8, -0.9, 0.9); // poses that training has not seen
            const auto expected = splats_of(training.backend, training.model, motion);
            CHECK(splats_of(training.backend, avatar, motion) == expected);
            CHECK(splats_of(threads, threaded, motion) == expected);
            CHECK(splats_of(training.backend, meant, motion) != expected);
        }
        std::filesystem::remove(path);
    }
}

TEST_CASE("a light comes back from a file and shades a new motion as in training, with or without an occlusion field") {
    for (const std::string ao : {AmbientOcclusion::none, AmbientOcclusion::pose}) {
        ShadedTraining training(ao, 1, 5e-3, even_light(2, 3, {0, 0.8, 0}, 3));
        for (int i = 0; i < 3; ++i) training.trainer.step(0.9);
        const AvatarData saved = training.avatar();
        const auto path = temporary("lit.gsh");
        save_avatar(path, saved);
        const AvatarData data = load_avatar(path);
        REQUIRE(data.light);
        CHECK(data.light->points == saved.light->points);
        CHECK(data.light->directions == saved.light->directions);
        CHECK(data.light->log_intensities == saved.light->log_intensities);
        CHECK(data.light->gloss == saved.light->gloss);
        CHECK(data.light->shadows);
        CHECK(data.light_place.low == saved.light_place.low);
        CHECK(data.light_place.high == saved.light_place.high);
        CHECK(data.light_place.upright == saved.light_place.upright);
        CHECK(data.normal_offsets == saved.normal_offsets);
        CHECK(std::any_of(data.normal_offsets.begin(), data.normal_offsets.end(),
                          [](const vec3<float>& offset) { return offset != vec3<float>(0); }));
        CHECK(data.mean_irradiance == saved.mean_irradiance);
        CHECK(data.mean_irradiance.size() == training.model.size());
        CHECK(data.occlusion_field.has_value() == (ao == AmbientOcclusion::pose));

        Avatar<cpu::Serial> avatar(training.backend, data);
        cpu::Threads threads(3);
        const Avatar<cpu::Threads> threaded(threads, data);
        Motion motion = training.scene.motion;
        test::Rng rng(4);
        for (int i = 0; i < 2; ++i) {
            if (i) motion.pose = rng.vecs(8, -0.9, 0.9);
            const auto expected = splats_of(training.backend, training.model, motion);
            CHECK(splats_of(training.backend, avatar, motion) == expected);
            CHECK(splats_of(threads, threaded, motion) == expected);
        }
        // Another light, and back.
        const auto before = splats_of(training.backend, avatar, motion);
        LightData other = *data.light;
        for (double& number : other.log_intensities) number += 1;
        avatar.set_light(other);
        CHECK(splats_of(training.backend, avatar, motion) != before);
        avatar.set_light(even_light(0, 5, {0, 0, 0}, 1));
        avatar.set_light(*data.light);
        CHECK(splats_of(training.backend, avatar, motion) == before);
        CHECK_THROWS_AS(avatar.set_light({}), ValueError);
        std::filesystem::remove(path);
    }
    cpu::Serial backend;
    Avatar<cpu::Serial> unlit(backend, small_avatar());
    CHECK_FALSE(unlit.is_lit());
    CHECK_THROWS_AS(unlit.set_light(even_light(1, 1, {0, 0, 0}, 1)), ValueError);
    AvatarData bad = small_avatar();
    bad.light = even_light(1, 1, {0, 0, 0}, 1), bad.light->log_intensities.pop_back();
    CHECK_THROWS_AS(save_avatar(temporary("bad.gsh"), bad), ShapeError);
    bad = small_avatar(), bad.normal_offsets = {{1, 0, 0}};
    CHECK_THROWS_AS(save_avatar(temporary("bad.gsh"), bad), ShapeError);
    bad = small_avatar(), bad.mean_irradiance = {1};
    CHECK_THROWS_AS(save_avatar(temporary("bad.gsh"), bad), ShapeError);
}

TEST_CASE("shadows that know only the time are a mean in the file, and none before they are learned") {
    ShadedTraining training(AmbientOcclusion::time);
    const AvatarData data = training.avatar();
    CHECK(!data.occlusion_field);
    CHECK(data.ao == mean_ao(training.people, photographed_frames(training.scene.photos)));
    CHECK(data.ao.size() == training.model.size());
    const auto [least, most] = std::minmax_element(data.ao.begin(), data.ao.end());
    CHECK(*least < *most);
    training.trainer.resume(12, 0); // before ao_start
    CHECK(training.avatar().ao.empty());

    ShadedTraining bent(AmbientOcclusion::pose);
    bent.trainer.resume(12, 0); // before ao_start
    CHECK(!bent.avatar().occlusion_field);
    ShadedTraining flat(AmbientOcclusion::pose, 0); // a single matrix has no first layer to bake
    CHECK(!flat.avatar().occlusion_field);
    CHECK(!flat.avatar().ao.empty());
}

TEST_CASE("a field of shadows that does not fit its avatar is refused by name") {
    ShadedTraining training(AmbientOcclusion::pose);
    const AvatarData good = training.avatar();
    const auto path = temporary("shades.gsh");
    const auto save_error = [&](const auto& change) {
        AvatarData avatar = good;
        change(*avatar.occlusion_field);
        return message_of([&] { save_avatar(path, avatar); });
    };
    CHECK(save_error([](auto& field) { field.neurons.pop_back(); }) == test::contains("neurons"));
    CHECK(save_error([](auto& field) { field.width = 0; }) == test::contains("width"));
    CHECK(!std::filesystem::exists(path));

    // Changes that another program may have made to the file.
    const auto load_error = [&](const std::string& member, const std::string& bytes) {
        save_avatar(path, good);
        replace_member(path, member + ".npy", bytes);
        const std::string message = message_of([&] { (void)load_avatar(path); });
        CHECK(message == test::contains(path.string()));
        return message;
    };
    const std::string zeros(1 << 16, '\0'), N = std::to_string(training.model.size());
    const auto floats = [&](const std::string& shape, std::size_t count) {
        return test::npy_bytes("<f4", shape, zeros.substr(0, 4 * count));
    };
    const auto names = [&](const std::string& message, const char* word) {
        CAPTURE(message);
        CHECK(message == test::contains(word));
    };
    names(load_error("occlusion_neurons", floats("(" + N + ",)", training.model.size())), "two axes");
    names(load_error("occlusion_neurons", floats("(3, 16)", 48)), "neurons has 48 elements");
    names(load_error("occlusion_neurons", floats("(" + N + ", 0)", 0)), "columns");
    names(load_error("occlusion_neurons", test::npy_bytes("<f8", "(1, 1)", zeros.substr(0, 8))), "occlusion_neurons");
    names(load_error("occlusion_pose_weights", floats("(16, 18)", 288)), "pose_weights has 288 elements");
    names(load_error("occlusion_weights", floats("(5,)", 5)), "weights has 5 elements");
    names(load_error("occlusion_weights", ""), "occlusion_weights");
    names(load_error("occlusion_weights", test::npy_bytes("<f4", "(272,)", zeros.substr(0, 1084) + "\xff\xff\xff\xff")),
          "weights[271]");
    names(load_error("occlusion_hidden_layers", test::npy_bytes("<i4", "()", "\xff\xff\xff\x7f")), "hidden_layers");
    names(load_error("occlusion_largest", test::npy_bytes("<f8", "()", zeros.substr(0, 8))), "largest");
    std::filesystem::remove(path);
}

TEST_CASE("ambient occlusion that is the same in every pose, deformation and filter come back from the file") {
    const auto path = temporary("parts.gsh");
    for (const Deformation deformation : {Deformation::linear, Deformation::polar, Deformation::dual_quaternion}) {
        AvatarData avatar = small_avatar();
        avatar.deformation = deformation;
        avatar.filter = {.dilation = 0.17, .compensate_opacity = deformation != Deformation::polar};
        test::Rng rng(9);
        if (deformation != Deformation::linear)
            for (std::size_t i = 0; i < avatar.gaussians.size(); ++i)
                avatar.ao.push_back(static_cast<float>(rng.uniform(0, 1.5)));
        save_avatar(path, avatar);
        const AvatarData back = load_avatar(path);
        CHECK(back.deformation == deformation);
        CHECK(back.ao == avatar.ao);
        CHECK(!back.occlusion_field);
        CHECK(back.filter.dilation == 0.17);
        CHECK(back.filter.compensate_opacity == avatar.filter.compensate_opacity);
    }
    AvatarData avatar = small_avatar();
    avatar.ao.assign(avatar.gaussians.size() - 1, 1.0f);
    save_avatar(path, avatar);
    CHECK(message_of([&] { (void)load_avatar(path); }) == test::contains("ao has"));
    avatar.ao.assign(avatar.gaussians.size(), std::numeric_limits<float>::infinity());
    save_avatar(path, avatar);
    CHECK(message_of([&] { (void)load_avatar(path); }) == test::contains("ao[0]"));
    save_avatar(path, small_avatar());
    replace_member(path, "deformation.npy", test::npy_bytes("<i4", "()", std::string("\3\0\0\0", 4)));
    CHECK(message_of([&] { (void)load_avatar(path); }) == test::contains("deformation is 3, expected 0 to 2"));
    std::filesystem::remove(path);
}

TEST_CASE("what cannot be an avatar is refused by name") {
    const auto path = temporary("bad.gsh");
    AvatarData avatar = small_avatar();
    avatar.gaussians.means[3].y = std::numeric_limits<float>::quiet_NaN();
    save_avatar(path, avatar);
    const std::string nan = message_of([&] { (void)load_avatar(path); });
    CHECK(nan == test::contains("the mean of Gaussian 3 is not finite"));
    CHECK(nan == test::contains(path.string()));

    test::check_throws<ValueError>([&] { save_avatar(path, avatar, ArrayStorage::compact); }, {"means[10]", "finite"});

    avatar = small_avatar();
    avatar.rig.skin.joints[0] = 4;
    save_avatar(path, avatar);
    CHECK(message_of([&] { (void)load_avatar(path); }) == test::contains("joint 4"));

    const auto refused = [&](const auto& change, const char* word) {
        avatar = small_avatar();
        change(avatar);
        save_avatar(path, avatar);
        const std::string message = message_of([&] { (void)load_avatar(path); });
        CAPTURE(message);
        CHECK(message == test::contains(word));
    };
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    const int V = static_cast<int>(avatar.rig.body.vertex_count());
    refused([&](AvatarData& a) { a.rig.triangles[2][1] = V; }, "triangles[7] is");
    refused([](AvatarData& a) { a.rig.triangles[0][0] = -1; }, "triangles[0] is -1");
    refused([](AvatarData& a) { a.rig.joints.pop_back(); }, "joints has 3 elements, expected 4");
    refused([](AvatarData& a) { a.rig.joints[1].x = none; }, "joints[3] is");
    refused([](AvatarData& a) { a.rig.barycentric[1].y = none; }, "barycentric[4] is");
    refused([](AvatarData& a) { a.rig.skin.weights[5] = none; }, "skin_weights[5] is");
    refused([](AvatarData& a) { a.rig.skin.weights[0] += 0.5; }, "skin_weights of Gaussian 0 sum to 1.5");
    refused([](AvatarData& a) { a.rig.barycentric[1].y = 1e31; }, "barycentric[4] is 1e+31");
    refused([](AvatarData& a) { a.gaussians.quats[1].w = float(none); }, "the quaternion of Gaussian 1 is 0 or not");
    refused([](AvatarData& a) { a.gaussians.quats[2] = {0, 0, 0, 0}; }, "the quaternion of Gaussian 2 is 0 or not");
    refused([](AvatarData& a) { a.gaussians.log_scales[1].y = 44.5f; }, "the scale of Gaussian 1 is e^44.5");

    avatar = small_avatar();
    avatar.gaussians.resize(avatar.gaussians.size() - 1, 2);
    CHECK_THROWS_AS(save_avatar(path, avatar), ShapeError);

    std::filesystem::resize_file(path, 1000);
    CHECK_THROWS_AS((void)load_avatar(path), IoError);
    std::filesystem::remove(path);
    CHECK_THROWS_AS((void)load_avatar(path), IoError);
}

TEST_CASE("a compact avatar is smaller, and every number is within its step") {
    const auto exact = temporary("exact.gsh"), compact = temporary("compact.gsh");
    AvatarData avatar = small_avatar();
    test::Rng rng(3);
    for (std::size_t i = 0; i < avatar.gaussians.size(); ++i) {
        avatar.ao.push_back(static_cast<float>(rng.uniform(0, 1)));
        avatar.mean_irradiance.push_back(static_cast<float>(rng.uniform(0.5, 2)));
        const quat<double> q = rng.quat();
        avatar.gaussians.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
    }
    save_avatar(exact, avatar);
    save_avatar(compact, avatar, ArrayStorage::compact);
    const AvatarData found = load_avatar(compact), same = load_avatar(exact);
    CHECK(same.gaussians.sh == avatar.gaussians.sh);
    CHECK(same.rig.body.weights == avatar.rig.body.weights);
    CHECK(same.rig.skin.weights == avatar.rig.skin.weights);
    CHECK(std::filesystem::file_size(compact) < std::filesystem::file_size(exact) / 2);
    const std::size_t N = avatar.gaussians.size();
    REQUIRE(found.gaussians.size() == N);
    CHECK(found.gaussians.sh_degree == 2);
    CHECK(found.rig.triangles == avatar.rig.triangles);
    CHECK(found.rig.joints == avatar.rig.joints);
    CHECK(found.rig.betas == avatar.rig.betas);
    for (std::size_t i = 0; i < N; ++i) {
        CHECK(length(found.gaussians.means[i] - avatar.gaussians.means[i]) < 1e-4f);
        CHECK(length(found.gaussians.log_scales[i] - avatar.gaussians.log_scales[i]) < 0.01f);
        CHECK(std::abs(found.gaussians.opacity_logits[i] - avatar.gaussians.opacity_logits[i]) < 0.01f);
        const mat3<float> a = rotation_matrix(normalize(found.gaussians.quats[i])),
                          b = rotation_matrix(normalize(avatar.gaussians.quats[i]));
        for (int c = 0; c < 3; ++c) CHECK(length(a[c] - b[c]) < 2e-4f);
        CHECK(std::abs(found.ao[i] - avatar.ao[i]) < 0.005f);
        CHECK(std::abs(found.mean_irradiance[i] - avatar.mean_irradiance[i]) < 0.01f);
        CHECK(length(found.rig.barycentric[i] - avatar.rig.barycentric[i]) < 1e-4);
        double sum = 0;
        for (std::size_t k = 0; k < found.rig.skin.influences; ++k) {
            const std::size_t at = i * found.rig.skin.influences + k;
            CHECK(std::abs(found.rig.skin.weights[at] - avatar.rig.skin.weights[at]) < 1e-3);
            sum += found.rig.skin.weights[at];
        }
        CHECK(sum == doctest::Approx(1).epsilon(1e-12));
    }
    for (std::size_t k = 0; k < avatar.gaussians.sh.size(); ++k)
        CHECK(length(found.gaussians.sh[k] - avatar.gaussians.sh[k]) < 0.015f);
    for (std::size_t v = 0; v < avatar.rig.body.vertex_count(); ++v)
        CHECK(length(found.rig.body.v_template[v] - avatar.rig.body.v_template[v]) < 1e-4);
    std::filesystem::remove(exact), std::filesystem::remove(compact);
}

TEST_CASE("avatars of version 4, whose arrays are dense, are read") {
    const auto path = temporary("version4.gsh");
    const AvatarData avatar = small_avatar();
    {
        ArchiveWriter file(path, "avatar", 4);
        add_body_model(file, avatar.rig.body, "body/");
        file.add("betas", avatar.rig.betas);
        file.add_rows<double>("joints", avatar.rig.joints);
        detail::add_exact_points(file, avatar);
        file.add("sh_degree", std::int32_t(2));
        file.add("clamp_above", std::int32_t(0));
        file.add("dilation", 0.3);
        file.add("compensate_opacity", std::int32_t(0));
        file.add("deformation", std::int32_t(0));
        file.commit();
    }
    const AvatarData found = load_avatar(path);
    CHECK(found.gaussians.sh == avatar.gaussians.sh);
    CHECK(found.rig.body.weights == avatar.rig.body.weights);
    std::filesystem::remove(path);
}
