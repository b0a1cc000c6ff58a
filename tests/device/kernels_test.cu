// SPDX-License-Identifier: Apache-2.0
/// @file  Every per-element function and every function object as device code: nvcc compiles them all here, and where a
///        device answers, its results are compared with the host's.
#include "support/elements.hpp"

#include <gsh/avatar/facing_weights.hpp>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/body/posed_surface.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/image/chroma.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/reduce.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/learn/density_control.hpp>
#include <gsh/light/coarse_caster.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/model/avatar_model.hpp>
#include <gsh/model/field_appearance.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/photo/backdrop.hpp>
#include <gsh/photo/photo_gain.hpp>
#include <gsh/photo/photo_loss.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/registration/keypoint_term.hpp>
#include <gsh/render/tiles.hpp>
#include <gsh/train/static_model.hpp>
#include <gsh/train/step_history.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <tuple>
#include <type_traits>
#include <vector>

namespace {

using namespace gsh;

constexpr int skipped = 77; // what ctest is told to read as "skipped"

/// What a device backend's for_each launches.
template <class Body>
__global__ void for_each_kernel(std::size_t n, Body body) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(blockDim.x) + threadIdx.x;
    if (i < n) body(i);
}

/// One element on its own numbers.
template <class Element, class T>
struct RunElement {
    Element element;
    Span<const T> in, table;
    Span<T> out;

    GSH_HD void operator()(std::size_t i) const {
        element.run(test::Inputs<T>(in.data() + i * test::element_inputs),
                    test::Outputs<T>(out.data() + i * test::element_outputs), table.data());
    }
};

/// Blends of bones take joint indices, which are no lane's numbers; so they are here and not among the elements.
template <class T, class Bone>
struct Skin {
    SkinWeights<T> skin;
    Span<const Bone> bones, dL_dblended;
    Span<Bone> blended, dL_dbones;

    GSH_HD void operator()(std::size_t i) const {
        blended[i] = blend(skin, i, bones);
        blend_backward(skin, i, bones, dL_dblended[i], dL_dbones);
    }
};

/// The adjoint of a skinned Gaussian adds to bones and a centre that its caller owns.
template <int Degree, class T, class D = LinearBlend>
struct SkinnedBackward {
    gsh::detail::SkinnedSplatBackward<Degree, T, D> body;
    Span<typename D::template Bone<T>> dL_dbones; // [N, J]
    Span<vec3<T>> dL_dcenters; // [N]
    std::size_t joint_count;

    GSH_HD void operator()(std::size_t i) const {
        body(i, dL_dbones.subspan(i * joint_count, joint_count), dL_dcenters[i]);
    }
};

/// The adjoint of a vertex under a light adds to sums and a centre that its caller owns.
template <class T>
struct LitBackward {
    gsh::detail::LitVertexBackward<T> body;
    Span<vec3<T>> dL_dpoints, dL_dcenters;             // [V, P], [V]
    Span<T> dL_dlog_intensities, dL_dgloss;            // [V, P + D], [V, 2]

    GSH_HD void operator()(std::size_t v) const {
        const auto& light = body.surface.light;
        body(v,
             {dL_dpoints.data() + v * light.points.size(), dL_dlog_intensities.data() + v * light.size(),
              dL_dgloss.data() + 2 * v},
             dL_dcenters[v]);
    }
};

template <class T>
struct HashTableBackward {
    HashGrid<5, 2> grid;
    Span<const vec3<T>> points;
    Span<const T> dL_dfeatures;
    Span<T> dL_dtable;

    GSH_HD void operator()(std::size_t i) const {
        grid.encode_backward_table(points[i], dL_dfeatures.data() + 10 * i, dL_dtable.data());
    }
};

/// How many tiles an ellipse touches, row by row; pixels and tiles are integers, which no lane has.
template <class T>
struct TilesTouched {
    Span<const vec3<T>> covariances; // xx, xy, yy
    Span<const vec3<T>> centers;
    TileGrid grid;
    Span<int> counts;

    GSH_HD void operator()(std::size_t i) const {
        const sym2<double> covariance{covariances[i].x, covariances[i].y, covariances[i].z};
        const double x = centers[i].x, y = centers[i].y, reach = 4;
        const Ellipse<double> ellipse{x, y, whiten(covariance), reach};
        const TileRect rect = tile_rect(x, y, sqrt(squared_extent(reach, covariance.xx)),
                                        sqrt(squared_extent(reach, covariance.yy)), grid);
        for (int row = rect.y0; row < rect.y1; ++row) {
            int first, end;
            tile_columns(ellipse, row, grid, first, end);
            counts[i] += end - first;
        }
    }
};

template <class... T>
struct Types {};

/// The function objects that backend.for_each is given; tests/house sees that none is missing.
template <class T>
using Bodies = Types<
    gsh::detail::StaticSplatForward<0, T>, gsh::detail::StaticSplatForward<2, T>, gsh::detail::StaticSplatForward<4, T>,
    gsh::detail::StaticSplatBackward<0, T>, gsh::detail::StaticSplatBackward<2, T>,
    gsh::detail::StaticSplatBackward<4, T>, gsh::detail::SkinnedSplatForward<2, T>,
    gsh::detail::SkinnedSplatForward<3, T>, SkinnedBackward<2, T>, SkinnedBackward<3, T>,
    gsh::detail::SkinnedSplatForward<2, T, PolarBlend>, gsh::detail::SkinnedSplatForward<2, T, DualQuaternionBlend>,
    SkinnedBackward<2, T, PolarBlend>, SkinnedBackward<2, T, DualQuaternionBlend>, gsh::detail::BonesAsDualQuats<T>,
    gsh::detail::BonesAsDualQuatsBackward<T>, gsh::detail::PoseRotations<T>, gsh::detail::PoseRotationsBackward<T>,
    gsh::detail::PoseFeature<T>, gsh::detail::PoseFeatureBackward<T>, gsh::detail::BoneTransforms<T>,
    gsh::detail::BoneTransformsBackward<T>, gsh::detail::SurfaceGather<T>, gsh::detail::SurfaceScatter<T>,
    gsh::detail::LitFactors<T>, gsh::detail::LitVertexForward<T>, gsh::detail::LitColorForward<T>,
    gsh::detail::LitColorBackward<T>, LitBackward<T>,
    gsh::detail::HashBackwardPoint<HashGrid<5, 2>, T>, gsh::detail::ResamplePlanes<T, UndistortMap<T>>,
    gsh::detail::ResampleRgba8<T, UndistortMap<T>>, gsh::detail::ReduceRgba8,
    gsh::detail::CompositeRgba8<false, T, gsh::detail::PlainBackground<T>>,
    gsh::detail::CompositeRgba8<false, T, gsh::detail::ImageBackground<T>>,
    gsh::detail::CompositeRgba8<true, T, gsh::detail::PlainBackground<T>>,
    gsh::detail::CompositeRgba8<true, T, gsh::detail::ImageBackground<T>>,
    gsh::detail::AverageChroma<T>, gsh::detail::InterpolateChroma<T>, gsh::detail::InterpolateChromaBackward<T>,
    gsh::detail::AverageChromaBackward<T>, gsh::detail::UnknownBackground<T>, gsh::detail::UnknownColors<T>,
    gsh::detail::HiddenTruth<T>, gsh::detail::HiddenGradient<T>,
    gsh::detail::ApplyGain<T>, gsh::detail::ApplyGainBackward<T>, gsh::detail::MoveGains<T>,
    gsh::detail::KeepMoments<T>,
    gsh::detail::Difference<T>, gsh::detail::Accumulate<T>, gsh::detail::Accumulate<vec3<T>>,
    gsh::detail::KeypointPull<T>,
    gsh::detail::ObserveSplats<T>, gsh::detail::DecideFates<T>, gsh::detail::DescendGaussian<T>,
    gsh::detail::DescendMoments<T>, gsh::detail::LimitFromAbove<T>, gsh::detail::StoreStepValue,
    gsh::detail::AoFromLogit<T>, gsh::detail::AoFromLogitBackward<T>, gsh::detail::PoseOfNeurons<T>,
    gsh::detail::PoseOfNeuronsBackward<T>, gsh::detail::DisplacedMeans<T>, gsh::detail::FilledAppearance<T>,
    gsh::detail::AddFacingWeights<T>,
    gsh::detail::RowGradient<T>,
    gsh::detail::ScaleConstant<T>, gsh::detail::WidenSh<T>, TilesTouched<T>,
    gsh::detail::AdamStep<T>, Skin<T, Affine<T>>, Skin<T, dual_quat<T>>, HashTableBackward<T>,
    gsh::detail::TurnedPose<T>, gsh::detail::TurnedPoseBackward<T>, gsh::detail::Incremented<T>,
    gsh::detail::PullGradient<T>, gsh::detail::MovedCamera<T>, gsh::detail::MovedCameraBackward<T>,
    gsh::detail::RowSteps<T>,
    gsh::detail::SequenceGradient<RotationSequence<T>, vec3<T>>, gsh::detail::SequenceGradient<NumberSequence<T>, T>,
    gsh::detail::PoseVertex<T>, gsh::detail::TriangleCross<T>, gsh::detail::VertexNormal<T>,
    gsh::detail::VertexNormalBackward<T>, gsh::detail::PoseVertexBackward<T>, gsh::detail::BonePieceBackward<T>,
    gsh::detail::JoinBonePieces<T>, gsh::detail::OffsetNormal<T>, gsh::detail::OffsetNormalBackward<T>,
    gsh::detail::PickVertices<T>, gsh::detail::BoundShadowCasters<T>,
    gsh::detail::AimShadowMaps<T>, gsh::detail::ReceiveShadows<T>,
    gsh::detail::SequenceValue<RotationSequence<T>, T>, gsh::detail::SequenceValue<NumberSequence<T>, T>>;

bool failed = false;

void check(cudaError_t status, const char* what) {
    if (status == cudaSuccess) return;
    std::printf("%s: %s\n", what, cudaGetErrorString(status));
    failed = true;
}

/// Makes nvcc emit the kernel; on a machine with a device, asks the driver whether it can load it.
template <class Body>
void emit_kernel(bool device) {
    static_assert(std::is_trivially_copyable_v<Body>, "a function object travels to the device as its bytes");
    cudaFuncAttributes attributes;
    const auto kernel = &for_each_kernel<Body>;
    if (device)
        check(cudaFuncGetAttributes(&attributes, reinterpret_cast<const void*>(kernel)), "cudaFuncGetAttributes");
}

template <class Element, class T>
void compare_with_host(bool device, double tolerance) {
    emit_kernel<RunElement<Element, T>>(device);
    if (!device) return;
    constexpr std::size_t count = 1000;
    std::vector<T> in(count * test::element_inputs), table(test::element_table_size);
    std::vector<T> expected(count * test::element_outputs, T(0)), found(expected);
    Rng rng(17);
    for (T& number : in) number = static_cast<T>(rng.uniform(-1, 1));
    for (T& number : table) number = static_cast<T>(rng.uniform(-1, 1));
    RunElement<Element, T> body{Element(), in, table, expected};
    for (std::size_t i = 0; i < count; ++i) body(i);

    T *device_in = nullptr, *device_table = nullptr, *device_out = nullptr;
    check(cudaMalloc(&device_in, in.size() * sizeof(T)), "cudaMalloc");
    check(cudaMalloc(&device_table, table.size() * sizeof(T)), "cudaMalloc");
    check(cudaMalloc(&device_out, found.size() * sizeof(T)), "cudaMalloc");
    check(cudaMemcpy(device_in, in.data(), in.size() * sizeof(T), cudaMemcpyHostToDevice), "upload");
    check(cudaMemcpy(device_table, table.data(), table.size() * sizeof(T), cudaMemcpyHostToDevice), "upload");
    check(cudaMemset(device_out, 0, found.size() * sizeof(T)), "cudaMemset");
    body.in = {device_in, in.size()};
    body.table = {device_table, table.size()};
    body.out = {device_out, found.size()};
    for_each_kernel<<<(count + 127) / 128, 128>>>(count, body);
    check(cudaGetLastError(), Element::name);
    check(cudaMemcpy(found.data(), device_out, found.size() * sizeof(T), cudaMemcpyDeviceToHost), Element::name);
    check(cudaFree(device_in), "cudaFree");
    check(cudaFree(device_table), "cudaFree");
    check(cudaFree(device_out), "cudaFree");

    // An element that amplifies roundings is one where the host's float is far from its double, too.
    std::vector<double> exact(found.size(), 0.0);
    const std::vector<double> exact_in(in.begin(), in.end()), exact_table(table.begin(), table.end());
    const RunElement<Element, double> exact_body{Element(), exact_in, exact_table, exact};
    double largest = 0;
    std::size_t where = 0;
    for (std::size_t element = 0; element < count; ++element) {
        exact_body(element);
        const std::size_t begin = element * test::element_outputs, end = begin + test::element_outputs;
        const auto relative = [&](double value, std::size_t i) {
            return std::abs(value - static_cast<double>(expected[i])) /
                   std::max(1.0, std::abs(static_cast<double>(expected[i])));
        };
        double rounding = 0;
        for (std::size_t i = begin; i < end; ++i) rounding = std::max(rounding, relative(exact[i], i));
        for (std::size_t i = begin; i < end; ++i) {
            const double error = relative(static_cast<double>(found[i]), i) / (1 + 4 * rounding / tolerance);
            if (!(error <= largest)) largest = error, where = i;
        }
    }
    const bool good = largest <= tolerance;
    failed = failed || !good;
    std::printf("%-32s %s  largest difference %.2e at element %zu, output %zu%s\n", Element::name,
                sizeof(T) == 4 ? "float " : "double", largest, where / test::element_outputs,
                where % test::element_outputs, good ? "" : "  TOO MUCH");
}

template <class... Element>
void compare_elements(std::tuple<Element...>*, bool device) {
    // The device contracts products and sums into one rounding, and has its own exp, log, sin and cos.
    (compare_with_host<Element, float>(device, 1e-4), ...);
    (compare_with_host<Element, double>(device, 1e-12), ...);
}

template <class... Body>
void emit_bodies(Types<Body...>, bool device) {
    (emit_kernel<Body>(device), ...);
}

} // namespace

int main() {
    int devices = 0;
    const bool device = cudaGetDeviceCount(&devices) == cudaSuccess && devices > 0;
    compare_elements(static_cast<test::Elements*>(nullptr), device);
    emit_bodies(Bodies<float>{}, device);
    emit_bodies(Bodies<double>{}, device);
    if (!device) {
        std::printf("SKIPPED: the kernels compile, but no device answers on this machine, so none of them ran\n");
        return skipped;
    }
    std::printf(failed ? "FAILED\n" : "the device agrees with the host\n");
    return failed ? 1 : 0;
}
