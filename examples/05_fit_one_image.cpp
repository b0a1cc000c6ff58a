// SPDX-License-Identifier: Apache-2.0
/// @file  Story 5: free Gaussians are fitted to one picture.
///
/// 1500 Gaussians have random positions in front of a camera. Training changes their positions, rotations, scales,
/// opacities and colours until they look like a landscape. A training step is ordinary code: forwards in order,
/// backwards in reverse. Writes 05_fit_one_image.png: truth | start | after 20 steps | end.
#include <gsh/core/rng.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/optim/schedule.hpp>
#include <gsh/render/rasterizer.hpp>

#include <story.hpp>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>

using namespace gsh;

namespace {

using Backend = cpu::Threads;

// 1. The start: grey Gaussians at random positions in a thin slab around z = 0.
GaussianCloud<float> random_blobs(std::size_t count) {
    GaussianCloud<float> cloud(count, 0);
    Rng rng(5);
    const auto uniform = [&rng](double reach) { return static_cast<float>(rng.uniform(-reach, reach)); };
    for (std::size_t i = 0; i < count; ++i) {
        cloud.means[i] = {uniform(0.5), uniform(0.5), uniform(0.02)};
        cloud.quats[i] = {1, uniform(0.5), uniform(0.5), uniform(0.5)};
        cloud.log_scales[i] = vec3<float>(std::log(0.012f));
    }
    return cloud;
}

// 2. The state of one fit. All buffers are created once, so steps allocate nothing.
class PictureFit {
public:
    PictureFit(Backend& backend, const GaussianCloud<float>& start, const Image<float>& truth)
        : backend_(backend), to_splats_(backend), rasterizer_(backend), loss_(backend), truth_(truth),
          render_(3, truth.height, truth.width), dL_drender_(render_) {
        upload(backend, start, gaussians_);
        for (auto* like : {&dL_dgaussians_, &m_, &v_}) {
            like->resize(start.size(), start.sh_degree);
            fill_zero(backend_, like->view());
        }
        splats_.resize(start.size());
        dL_dsplats_.resize(start.size());

        // The camera is one metre in front of the slab and sees one metre of it.
        camera_.t = {0, 0, 1};
        camera_.fx = camera_.fy = static_cast<float>(truth.width);
        camera_.cx = camera_.cy = 0.5f * static_cast<float>(truth.width);
        camera_.width = truth.width, camera_.height = truth.height;
    }

    // 3. Forwards in order: Gaussians → splats → picture → loss.
    double forward() {
        to_splats_.forward(gaussians_.view(), camera_.center(), splats_.view(), splats_cache_);
        rasterizer_.forward(camera_, splats_.view(), background_, {.color = render_.view()}, raster_cache_);
        loss_.forward(render_.view(), truth_.view(), loss_cache_);
        return loss_.values(loss_cache_).loss;
    }

    // 4. Backwards in reverse. Each adjoint adds to its outputs, so intermediate gradients start at zero.
    void backward() {
        backend_.fill(Span<float>(dL_drender_.data), 0.0f);
        loss_.backward(render_.view(), truth_.view(), 1.0f, loss_cache_, dL_drender_.view());
        fill_zero(backend_, dL_dsplats_.view());
        rasterizer_.backward(camera_, splats_.view(), background_, {.color = dL_drender_.view()}, raster_cache_,
                             dL_dsplats_.view());
        to_splats_.backward(gaussians_.view(), camera_.center(), dL_dsplats_.view(), splats_cache_,
                            dL_dgaussians_.view());
    }

    // 5. A step of Adam, with a rate for each attribute. It zeroes the gradients after use.
    void step(int number) {
        using examples::numbers;
        const auto move = [&](auto& values, auto& gradients, auto& m, auto& v, double rate) {
            adam_.step(backend_, numbers(values), numbers(gradients), numbers(m), numbers(v), rate, number,
                       UsedGradients::zero);
        };
        const double pace = Schedule::exponential(1, 0.1, 300).rate(number);
        move(gaussians_.means, dL_dgaussians_.means, m_.means, v_.means, 2e-3 * pace);
        move(gaussians_.quats, dL_dgaussians_.quats, m_.quats, v_.quats, 1e-2 * pace);
        move(gaussians_.log_scales, dL_dgaussians_.log_scales, m_.log_scales, v_.log_scales, 3e-2 * pace);
        move(gaussians_.opacity_logits, dL_dgaussians_.opacity_logits, m_.opacity_logits, v_.opacity_logits,
             5e-2 * pace);
        move(gaussians_.sh, dL_dgaussians_.sh, m_.sh, v_.sh, 5e-2 * pace);
    }

    [[nodiscard]] const Image<float>& render() const { return render_; }

private:
    Backend& backend_;
    StaticSplats<Backend, 0> to_splats_;
    Rasterizer<Backend> rasterizer_;
    PhotometricLoss<Backend> loss_;
    Adam adam_;
    Camera<float> camera_;
    Background<float> background_; // black
    Gaussians<Backend, float> gaussians_, dL_dgaussians_, m_, v_;
    Splats<Backend, float> splats_, dL_dsplats_;
    const Image<float>& truth_;
    Image<float> render_, dL_drender_;
    Rasterizer<Backend>::Cache raster_cache_;
    PhotometricLoss<Backend>::Cache loss_cache_;
    StaticSplats<Backend, 0>::Cache splats_cache_;
};

void story(const std::filesystem::path& folder) {
    Backend backend;
    const Image<float> truth = examples::landscape_picture(256);
    PictureFit fit(backend, random_blobs(1500), truth);

    Image<float> start, early;
    for (int step = 1; step <= 300; ++step) {
        const double loss = fit.forward();
        if (step == 1) start = fit.render();
        if (step == 21) early = fit.render();
        if (step == 1 || step % 50 == 0)
            std::printf("step %3d: loss %.4f, PSNR %.1f dB\n", step, loss, psnr(fit.render().view(), truth.view()));
        fit.backward();
        fit.step(step);
    }
    fit.forward();

    // 6. The picture and the figures.
    write_png(folder / "05_fit_one_image.png", examples::beside<float>({&truth, &start, &early, &fit.render()}));
    const double before = psnr(start.view(), truth.view()), after = psnr(fit.render().view(), truth.view());
    std::printf("PSNR %.1f dB at the start, %.1f dB at the end; SSIM %.3f\n", before, after,
                ssim(fit.render().view(), truth.view()));
    examples::claim(after > 35, "1500 Gaussians represent the landscape with more than 35 dB");
}

} // namespace

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
