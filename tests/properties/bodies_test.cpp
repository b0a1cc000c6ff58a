// SPDX-License-Identifier: Apache-2.0
/// Bodies, skeletons and avatars: the rest pose, rigid motions of the whole, equal bones, linear shapes.
#include "properties/properties.hpp"
#include "support/bodies.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/cpu/occlusion_field.hpp>
#include <gsh/avatar/cpu/skinned_splats.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/cpu/blend_shapes.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/static_gaussian.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::test;

namespace {

void require_close(const vec3<double>& found, const vec3<double>& expected, double tolerance, const char* what) {
    require(length(found - expected) <= tolerance, // false for NaN
            [&] { return std::string(what) + ": differs by " + digits(length(found - expected)); });
}

/// A tube of few joints, of which some may be in one place, and whose directions may be large.
BodyModel any_body() {
    BodyModel body = tube(1 + below(5), 3, 4, 1 + below(50));
    if (rarely(4)) body.posedirs.clear();
    if (rarely(4))
        for (auto& d : body.shapedirs) d = d * 30.0;
    if (rarely(4) && body.joint_count() > 1) body.J_regressor[1] = body.J_regressor[0];
    return body;
}

std::vector<vec3<double>> any_pose(std::size_t joints) {
    std::vector<vec3<double>> pose(joints);
    for (auto& v : pose) v = around(vec3<double>(0), one_of({1.5, 0.0, 4.0}));
    return pose;
}

std::vector<double> any_numbers(std::size_t count, double spread) {
    std::vector<double> numbers(count);
    for (double& n : numbers) n = around(0, spread);
    return numbers;
}

} // namespace

TEST_CASE("a body in the rest pose is its shaped mesh") {
    check_property([] {
        const BodyModel body = any_body();
        const auto betas = any_numbers(3, 3), expression = any_numbers(2, 3);
        const vec3<double> transl = around(vec3<double>(0), 10);
        const std::vector<vec3<double>> rest(body.joint_count(), vec3<double>(0));
        const PosedBody posed = pose_body(body, rest, transl, betas, expression);
        const auto shaped = shaped_vertices(body, betas, expression);
        const auto joints = regress_joints(body, shaped);
        for (std::size_t v = 0; v < shaped.size(); ++v)
            require_close(posed.vertices[v], shaped[v] + transl, 1e-13 * 30, "a vertex");
        for (std::size_t j = 0; j < joints.size(); ++j)
            require_close(posed.joints[j], joints[j] + transl, 1e-13 * 30, "a joint");
    });
}

TEST_CASE("a root that turns, turns the whole body") {
    check_property([] {
        const BodyModel body = any_body();
        std::vector<vec3<double>> pose = any_pose(body.joint_count()), turned = pose;
        const mat3<double> R = any_rotation();
        const vec3<double> t = around(vec3<double>(0), 5), moved = around(vec3<double>(0), 5);
        turned[0] = axis_angle_from_rotation(R * rotation_from_axis_angle(pose[0]));
        const PosedBody one = pose_body(body, pose, t), other = pose_body(body, turned, moved);
        // The root turns about its own joint, and transl comes after.
        const vec3<double> root = one.joints[0] - t;
        for (std::size_t v = 0; v < one.vertices.size(); ++v)
            require_close(other.vertices[v], R * (one.vertices[v] - t - root) + root + moved, 1e-12 * 30, "a vertex");
    });
}

TEST_CASE("bones keep their lengths, and a joint that turns moves nothing above it") {
    check_property([] {
        const BodyModel body = any_body();
        const std::size_t J = body.joint_count();
        std::vector<vec3<double>> pose = any_pose(J);
        const PosedBody rest = pose_body(body, std::vector<vec3<double>>(J, vec3<double>(0)));
        const PosedBody one = pose_body(body, pose);
        const std::size_t turned = below(J);
        pose[turned] = around(vec3<double>(0), 3);
        const PosedBody other = pose_body(body, pose);
        for (std::size_t j = 0; j < J; ++j) {
            if (j <= turned) require_close(other.joints[j], one.joints[j], 1e-13 * 30, "a joint above");
            if (j == 0) continue;
            const auto parent = static_cast<std::size_t>(body.parents[j]);
            const double before = length(rest.joints[j] - rest.joints[parent]);
            require(std::abs(length(one.joints[j] - one.joints[parent]) - before) <= 1e-12,
                    [] { return "a bone has another length"; });
        }
    });
}

TEST_CASE("skinning by equal bones is that motion, for matrices and for dual quaternions of any sign") {
    check_property([] {
        const std::size_t J = 1 + below(5), influences = 1 + below(3);
        const Affine<double> A(any_rotation(), around(vec3<double>(0), 10));
        std::vector<Affine<double>> bones(J, A);
        std::vector<dual_quat<double>> duals;
        for (std::size_t j = 0; j < J; ++j) {
            dual_quat<double> b = dual_quat<double>::zero();
            b.add_scaled(dual_quat_from_rigid(A), rarely(2) ? -1.0 : 1.0);
            duals.push_back(b);
        }
        std::vector<double> weights(influences);
        std::vector<std::uint16_t> joints(influences);
        double sum = 0;
        for (std::size_t k = 0; k < influences; ++k) {
            weights[k] = std::abs(around(0.5, 0.5)) + 1e-9, sum += weights[k];
            joints[k] = static_cast<std::uint16_t>(below(J));
        }
        for (double& w : weights) w /= sum;
        std::ranges::sort(weights, std::greater<>());
        const SkinWeights<double> skin{joints, weights, influences};
        const vec3<double> p = around(vec3<double>(0), 3);
        require_close(blend<double>(skin, 0, Span<const Affine<double>>(bones))(p), A(p), 1e-12, "matrices");
        const auto dual = rigid_from_dual_quat(blend<double>(skin, 0, Span<const dual_quat<double>>(duals)));
        require_close(dual(p), A(p), 1e-12, "dual quaternions");
    });
}

TEST_CASE("blend shapes are linear, and their adjoint is the transpose") {
    check_property([] {
        const std::size_t V = below(40), C = below(6);
        const auto directions = gsh::test::Rng(below(1000)).vecs(V * C);
        const auto a = any_numbers(C, 2), b = any_numbers(C, 2);
        const double s = around(1, 3);
        const auto check = [&](auto& backend) {
            using B = std::remove_reference_t<decltype(backend)>;
            const BlendShapes<B, double> shapes(backend, V, {directions});
            const auto offsets_of = [&](const std::vector<double>& c) {
                std::vector<vec3<double>> offsets(V, vec3<double>(0));
                if (V * C != 0) shapes.forward(c, offsets);
                return offsets;
            };
            std::vector<double> sum(C);
            for (std::size_t k = 0; k < C; ++k) sum[k] = a[k] + s * b[k];
            const auto one = offsets_of(a), other = offsets_of(b), both = offsets_of(sum);
            double inner = 0, transposed = 0;
            std::vector<double> dL_da(C, 0.0);
            const auto w = gsh::test::Rng(below(1000)).vecs(V);
            typename BlendShapes<B, double>::Workspace workspace;
            if (V * C != 0) shapes.backward(w, dL_da, workspace);
            for (std::size_t v = 0; v < V; ++v) {
                require_close(both[v], one[v] + other[v] * s, 1e-12, "the sum");
                inner += dot(one[v], w[v]);
            }
            for (std::size_t k = 0; k < C; ++k) transposed += dL_da[k] * a[k];
            require(std::abs(inner - transposed) <= 1e-11,
                    [&] { return digits(inner) + " and " + digits(transposed); });
        };
        static cpu::Serial serial;
        static cpu::Threads threads(3);
        check(serial), check(threads);
    });
}

TEST_CASE("an avatar in its rest pose shows its canonical Gaussians, and a root that turns turns them") {
    check_property([] {
        const BodyModel body = any_body();
        const auto betas = any_numbers(2, 1);
        const auto samples = sample_surface(body, shaped_vertices(body, betas),
                                            std::vector<double>(body.vertex_count(), 2.0 * double(below(10))), 3);
        AvatarData avatar{make_rig(body, betas, samples), GaussianCloud<float>(samples.size(), 1)};
        gsh::test::Rng rng(below(1000));
        const double reach = one_of({0.01, 0.3, 3.0});
        GaussianCloud<float>& cloud = avatar.gaussians;
        for (std::size_t i = 0; i < samples.size(); ++i) {
            cloud.means[i] = vec3<float>(samples.positions[i] + rng.vec() * reach);
            const auto q = rng.quat();
            cloud.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
            cloud.log_scales[i] = vec3<float>(rng.vec(-7, -2));
            cloud.opacity_logits[i] = float(rng.uniform(-20, 20));
        }
        for (auto& v : cloud.sh) v = vec3<float>(rng.vec(-0.2, 0.2));
        avatar.deformation = one_of({Deformation::linear, Deformation::polar, Deformation::dual_quaternion});
        Motion motion = rest_motion(avatar.rig);
        const bool turns = rarely(2);
        mat3<double> R(1.0);
        vec3<double> t(0);
        if (turns) {
            R = any_rotation(), t = around(vec3<double>(0), 3);
            motion.pose[0] = axis_angle_from_rotation(R), motion.transl[0] = t;
        }
        const vec3<double> root = avatar.rig.joints[0];
        const vec3<double> eye = around(vec3<double>(0, 1, 5), 1); // in the frame of the rest pose
        const auto check = [&](auto& backend) {
            using B = std::remove_reference_t<decltype(backend)>;
            const Avatar<B> shown(backend, avatar);
            RigPose<B> pose;
            shown.rig().upload_pose(motion, 0, pose);
            Splats<B> splats;
            splats.resize(shown.size());
            typename Avatar<B>::Cache cache;
            shown.pose(pose, vec3<float>(R * (eye - root) + root + t), splats.view(), cache);
            for (std::size_t i = 0; i < samples.size(); ++i) {
                const vec3<double> mean(cloud.means[i]);
                require_close(vec3<double>(splats.means[i]), R * (mean - root) + root + t, 1e-5, "a mean");
                const auto& q = cloud.quats[i];
                const mat3<double> M =
                    R * covariance_factor(quat<double>{q.w, q.x, q.y, q.z}, vec3<double>(cloud.log_scales[i]));
                const sym3<double> S = gram(M);
                const sym3<float>& found = splats.covariances[i];
                const double trace = S.xx + S.yy + S.zz;
                for (const double difference : {found.xx - S.xx, found.xy - S.xy, found.xz - S.xz, found.yy - S.yy,
                                                found.yz - S.yz, found.zz - S.zz})
                    require(std::abs(difference) <= 1e-5 * trace,
                            [&] { return "a covariance: " + digits(difference / trace); });
                require(std::abs(splats.opacities[i] - sigmoid(double(cloud.opacity_logits[i]))) <= 1e-6,
                        [] { return "an opacity"; });
                const vec3<float> color =
                    shade<1>(&cloud.sh[4 * i], vec3<float>(normalize(mean - eye)), 1.0f, avatar.clamping);
                require_close(vec3<double>(splats.colors[i]), vec3<double>(color), 1e-5, "a colour");
            }
        };
        static cpu::Serial serial;
        static cpu::Threads threads(3);
        check(serial), check(threads);
    });
}
