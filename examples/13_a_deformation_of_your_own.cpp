// SPDX-License-Identifier: Apache-2.0
/// @file  Story 13: Gaussians follow a blend of bones that gsh does not have. It is linear blending, divided by the cube
/// root of its determinant, so that Gaussians keep their volume where bones differ.
#include <filmed_actor.hpp>
#include <gsh/model/shared_field.hpp>
#include <story.hpp>
using namespace gsh;
using Device = cpu::Threads; // another backend is a change of this line

// 1. The policy: M moves the mean; A = s M, s = det(M)^(-1/3), moves covariance and colour. ds = -s/3 (M⁻ᵀ · dM).
struct KeepVolume {
    template <class T>
    using Bone = Affine<T>;
    template <Lane T>
    using Direction = CanonicalDirection<T>;
    template <Lane T>
    struct Transform {
        const Affine<T>& M;
        T det, s;
        mat3<T> A;
        GSH_HD explicit Transform(const Affine<T>& blend)
            : M(blend), det(max(determinant(M.linear), T(0.01))), s(exp(log(det) * T(-1.0 / 3))), A(M.linear * s) {}
        GSH_HD const Affine<T>& map() const { return M; }
        GSH_HD const mat3<T>& turn() const { return A; }
        using Gradient = typename PolarBlend::Transform<T>::Gradient; // of M, and of A apart from it
        GSH_HD void complete(Gradient& g, Affine<T>& dL_dM) const {
            const mat3<T>&G = g.turn(), &L = M.linear;
            const T dL_ddet = (dot(G[0], L[0]) + dot(G[1], L[1]) + dot(G[2], L[2])) * s / det * T(-1.0 / 3);
            for (int c = 0; c < 3; ++c) dL_dM.linear[c] += G[c] * s + cross(L[(c + 1) % 3], L[(c + 2) % 3]) * dL_ddet;
        }
    };
};

void story(const std::filesystem::path&) { // 2. The adjoint of Σ A² is the central difference, in double.
    Affine<double> M(mat3<double>({0.9, 0.2, -0.1}, {-0.1, 0.7, 0.3}, {0, 0, 1}), {0, 0, 0}),
        dL_dM = Affine<double>::zero();
    const KeepVolume::Transform<double> transform(M);
    KeepVolume::Transform<double>::Gradient gradient(dL_dM);
    gradient.turn() = transform.turn() * 2.0;
    transform.complete(gradient, dL_dM);
    const auto sum = [&](double off) {
        M.linear[1][2] = 0.3 + off;
        const mat3<double> A = KeepVolume::Transform<double>(M).turn();
        return dot(A[0], A[0]) + dot(A[1], A[1]) + dot(A[2], A[2]);
    };
    examples::claim(std::abs(dL_dM.linear[1][2] - (sum(1e-5) - sum(-1e-5)) / 2e-5) < 1e-8, "the adjoint is right");
    // 3. A model with this deformation, trained by gsh's trainer.
    Device backend;
    const examples::FilmedActor actor(backend);
    AvatarModel<Device, SharedField<Device>, NoOcclusion<Device>, float, KeepVolume> model(
        backend, actor.rig, actor.skin, actor.points, SharedField<Device>(backend, actor.points));
    AvatarScene scene(backend, model, actor.motion);
    Trainer trainer(backend, scene, photos_of(actor.capture, false), 1);
    for (int step = 0; step < 200; ++step) trainer.step(step / 200.0);
    examples::claim(trainer.last_psnr() > 25, "the PSNR of the avatar is above 25 dB");
}

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
