// SPDX-License-Identifier: Apache-2.0
/// @file  film_people: films dressed people of different shape in motion, to learn landmarks from.
///
/// film_people BODY.npz SKIN.png OUT SEED [FRAMES CAMERAS SIZE]. The seed chooses shape, motion, clothes, shoes, hair and
/// light. BODY has texture coordinates, and SKIN is a picture of skin and face in them. OUT becomes a capture whose poses
/// are those of the body under the clothes; BODY with its betas is the body of these poses.
#include <gsh/backend/threads.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/image/color.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/synthetic/studio.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// Joints by their number in SMPL-X.
enum Joint : std::size_t { left_ankle = 7, head = 15, left_eye = 23 };

/// What one person is like. Each number is drawn once, in a fixed order.
class Wardrobe {
public:
    explicit Wardrobe(std::uint64_t seed) : seed_(seed) {}
    /// Uniform in [low, high), always the same for the same item.
    [[nodiscard]] double draw(std::uint64_t item, double low, double high) const {
        return low + (high - low) * random_uniform(mix_bits(seed_), item);
    }
    [[nodiscard]] vec3<double> color(std::uint64_t item, double most) const {
        return {srgb_to_linear(draw(item, 0, most)), srgb_to_linear(draw(item + 1, 0, most)),
                srgb_to_linear(draw(item + 2, 0, most))};
    }

private:
    std::uint64_t seed_;
};

/// What is worn where, by the place on a body at rest in a T that looks along z and whose pelvis is the origin.
///
/// Units  metres; thicknesses are those by which the skin moves outward.
struct Clothes {
    bool worn;
    double sleeve, trouser_end, sole, shoe, hair, shirt, trousers;
    vec3<double> top, bottom, tone;
    double stripe;

    explicit Clothes(const Wardrobe& of)
        : worn(of.draw(1, 0, 1) < 0.75), sleeve(of.draw(2, 0.25, 0.65)), trouser_end(of.draw(3, -0.8, -0.3)),
          sole(of.draw(4, 0.01, 0.035)), shoe(of.draw(5, 0.004, 0.012)),
          hair(of.draw(6, 0, 1) < 0.3 ? 0.004 : of.draw(7, 0.01, 0.045)), shirt(of.draw(8, 0.004, 0.022)),
          trousers(of.draw(9, 0.004, 0.019)), top(of.color(10, 1)), bottom(of.color(13, 0.6)),
          tone(srgb_to_linear(of.draw(16, 0.45, 1)) * vec3<double>(1, 0.95, 0.9)),
          stripe(of.draw(17, 0, 1) < 0.5 ? 120 : 0) {}
    [[nodiscard]] bool shirt_at(const vec3<double>& p) const {
        return worn && p.y > waist && p.y < neck && std::abs(p.x) < sleeve;
    }
    [[nodiscard]] bool trousers_at(const vec3<double>& p) const { return worn && p.y <= waist && p.y > trouser_end; }

    static constexpr double waist = -0.05, neck = 0.5;
};

/// The body in its clothes: the skin moves outward, the joints stay in their places for every shape.
BodyModel dressed(const BodyModel& body, const Clothes& clothes) {
    const auto joints = regress_joints(body, body.v_template);
    const auto joint_shapes = joint_directions(body, body.shapedirs);
    const auto normals = vertex_normals(body.v_template, body.faces);
    const double ankle = joints[left_ankle].y, eye = joints[left_eye].y, hair_front = joints[head].z + 0.02;
    BodyModel result = body;
    for (std::size_t i = 0; i < body.vertex_count(); ++i) {
        const vec3<double>& p = body.v_template[i];
        double outward = 0, down = 0;
        if (p.y < ankle + 0.02) {
            outward = clothes.shoe;
            if (p.y < ankle - 0.02) down = clothes.sole;
        } else if (p.y > eye + 0.03 && std::abs(p.x) < 0.2 && (p.y > eye + 0.075 || p.z < hair_front)) {
            outward = clothes.hair * std::clamp((p.y - eye - 0.03) / 0.05, 0.3, 1.0);
        } else if (clothes.shirt_at(p)) { // with folds
            outward = clothes.shirt * (0.6 + 0.4 * std::sin(25 * p.y + 20 * p.x));
        } else if (clothes.trousers_at(p)) {
            outward = clothes.trousers * (0.7 + 0.3 * std::sin(22 * p.y));
        }
        result.v_template[i] += normals[i] * outward - vec3<double>(0, down, 0);
    }
    // Each joint becomes a vertex of its own, which no triangle shows, so that clothes do not move it.
    const auto shapes = static_cast<std::size_t>(body.shape_count);
    for (std::size_t j = 0; j < body.joint_count(); ++j) {
        result.J_regressor[j] = {{static_cast<int>(result.v_template.size()), 1.0}};
        result.v_template.push_back(joints[j]);
        for (std::size_t k = 0; k < shapes; ++k) result.shapedirs.push_back(joint_shapes[j * shapes + k]);
        result.exprdirs.resize(result.exprdirs.size() + static_cast<std::size_t>(body.expression_count));
        for (std::size_t k = 0; k < body.joint_count(); ++k) result.weights.push_back(j == k ? 1.0 : 0.0);
    }
    return result;
}

/// The colour of a canonical point: a picture of the skin by texture coordinates, and clothes over it.
class Look {
public:
    Look(const BodyModel& filmed, const PixelImage& skin, const Clothes& clothes)
        : body_(&filmed), skin_(&skin), clothes_(clothes), near_(filmed.v_template),
          triangles_(filmed.v_template.size()) {
        for (std::size_t f = 0; f < filmed.faces.size(); ++f)
            for (const int i : filmed.faces[f]) triangles_[static_cast<std::size_t>(i)].push_back(f);
    }
    [[nodiscard]] SurfaceColor operator()(const vec3<double>& p) const {
        constexpr double shoes = -0.83;
        if (clothes_.worn && p.y < shoes) return {vec3<double>(0.03)};
        if (clothes_.shirt_at(p)) return {clothes_.top * (std::sin(p.y * clothes_.stripe) > 0 ? 0.4 : 1.0)};
        if (clothes_.trousers_at(p)) return {clothes_.bottom};
        const vec2<double> uv = texture_place(p);
        const auto pixel = [](double share, int size) {
            return std::clamp(static_cast<int>(share * size), 0, size - 1);
        };
        const std::uint8_t* rgb = skin_->pixel(pixel(1 - uv.y, skin_->height), pixel(uv.x, skin_->width));
        return {vec3<double>(srgb_to_linear(rgb[0] / 255.0), srgb_to_linear(rgb[1] / 255.0),
                             srgb_to_linear(rgb[2] / 255.0)) *
                clothes_.tone};
    }

private:
    /// Texture coordinates of the nearest triangle among those at the nearest vertices.
    [[nodiscard]] vec2<double> texture_place(const vec3<double>& p) const {
        double least = std::numeric_limits<double>::infinity();
        vec2<double> place(0);
        for (const auto& [distance, vertex] : near_.nearest(p, 3))
            for (const std::size_t f : triangles_[vertex]) {
                const auto& corners = body_->faces[f];
                const auto at = [&](std::size_t k) { return body_->v_template[static_cast<std::size_t>(corners[k])]; };
                const vec3<double> a = at(0), b = at(1) - a, c = at(2) - a, normal = cross(b, c), q = p - a;
                const double area = dot(normal, normal);
                if (area == 0) continue;
                const double v = dot(cross(q, c), normal) / area, w = dot(cross(b, q), normal) / area, u = 1 - v - w;
                const double outside = std::max({0.0, -u, -v, -w}); // in heights of the triangle
                const double off = std::abs(dot(q, normal)) / std::sqrt(area) + outside * std::sqrt(std::sqrt(area));
                if (off >= least) continue;
                least = off;
                const auto texture = [&](std::size_t k) {
                    return body_->vt[static_cast<std::size_t>(body_->ft[f][k])];
                };
                place = texture(0) * u + texture(1) * v + texture(2) * w;
            }
        return place;
    }

    const BodyModel* body_;
    const PixelImage* skin_;
    Clothes clothes_;
    NearestPoints near_;
    std::vector<std::vector<std::size_t>> triangles_; // at each vertex
};

/// A motion within the limits of all joints: half of the people turn once around, the others turn to and fro.
Motion random_motion(const BodyModel& body, const Wardrobe& of, std::size_t frames) {
    const FittedBody fitted(body, 0);
    const bool turns = of.draw(20, 0, 1) < 0.5;
    Motion motion;
    motion.joint_count = body.joint_count(), motion.expression_count = 0;
    for (int k = 0; k < body.shape_count; ++k)
        motion.betas.push_back(k < 10 ? of.draw(100 + static_cast<std::uint64_t>(k), -1.7, 1.7) : 0);
    const double heading = of.draw(21, 0, 2 * std::numbers::pi), lean = of.draw(22, 0, 2 * std::numbers::pi);
    for (std::size_t t = 0; t < frames; ++t) {
        const double phase = 2 * std::numbers::pi * static_cast<double>(t) / static_cast<double>(frames);
        std::vector<double> angles;
        for (std::size_t a = 0; a < fitted.axes.size(); ++a) {
            const PoseAxis& axis = fitted.axes[a];
            const std::uint64_t item = 1000 + 3 * a;
            const double usual = axis.mean + of.draw(item, -0.3, 0.3) * axis.spread;
            const double wave =
                std::sin(std::floor(of.draw(item + 1, 1, 4)) * phase + of.draw(item + 2, 0, 2 * std::numbers::pi));
            angles.push_back(
                std::clamp(usual + (turns ? 0.2 : 0.5) * wave * axis.spread, 0.9 * axis.low, 0.9 * axis.high));
        }
        std::vector<vec3<double>> pose = fitted.pose(angles);
        const double yaw = turns ? phase : heading + 1.2 * std::sin(phase);
        pose[0] = axis_angle_from_rotation(
            rotation_from_axis_angle(vec3<double>(0, yaw, 0)) *
            rotation_from_axis_angle(vec3<double>(0.15 * std::sin(2 * phase + lean), 0, 0.1 * std::sin(phase))));
        motion.pose.insert(motion.pose.end(), pose.begin(), pose.end());
        motion.transl.emplace_back(0.0);
        motion.timestamps.push_back(static_cast<double>(t) / 10);
    }
    return motion;
}

} // namespace

int main(int argc, char** argv) {
    if (argc < 5 || argc > 8) {
        std::fprintf(stderr, "expected BODY.npz SKIN.png OUT SEED [FRAMES CAMERAS SIZE]\n");
        return 2;
    }
    try {
        const auto number = [&](int place, int otherwise) { return argc > place ? std::stoi(argv[place]) : otherwise; };
        const BodyModel body = load_body_model(argv[1]);
        check_value(!body.ft.empty(), argv[1], "has no texture coordinates (vt, ft)");
        const PixelImage skin = read_image(argv[2]);
        check_value(skin.channels >= 3, argv[2], "is not in colour");
        const auto seed = static_cast<std::uint64_t>(std::stoull(argv[4]));
        const Wardrobe wardrobe(seed);
        const Clothes clothes(wardrobe);
        const BodyModel filmed = dressed(body, clothes);
        StudioParams studio;
        studio.train_cameras = number(6, 4), studio.test_cameras = 0, studio.image_size = number(7, 540);
        studio.samples = 9, studio.seed = seed, studio.distance = wardrobe.draw(30, 2.6, 3.6);
        studio.light = wardrobe.draw(31, 0, 1) < 0.67 ? soft_light() : hard_light();
        cpu::Threads backend;
        const Motion motion = random_motion(body, wardrobe, static_cast<std::size_t>(number(5, 12)));
        save_capture(argv[3], film(backend, filmed, motion, studio, Look(filmed, skin, clothes)));
    } catch (const std::exception& error) {
        std::fprintf(stderr, "film_people: %s\n", error.what());
        return 2;
    }
    return 0;
}
