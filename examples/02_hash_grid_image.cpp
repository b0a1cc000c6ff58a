// SPDX-License-Identifier: Apache-2.0
/// @file  Story 2: a hash grid and a small network learn a picture.
///
/// HashField maps points of the unit cube to numbers. Avatars store colours and displacements in such fields. Here a
/// field learns a landscape, placed in the slice z = 1/2 of the cube, from 128 x 128 points. It is then evaluated
/// between these points. Writes 02_hash_grid_image.png: truth | learned.
#include <gsh/cpu.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/optim/adam.hpp>

#include <story.hpp>

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;

namespace {

using Backend = cpu::Threads;
using Field = HashField<8, 2>; // 8 levels with 2 numbers each

// A field, its parameters, and Adam's moments.
struct LearnedField {
    Field field{{.base = 4, .growth = 1.6, .table_size = 1u << 15}, {.outputs = 3, .width = 32, .hidden_layers = 2}};
    std::vector<float> table = field.grid().initial_table<float>(1), weights = field.mlp().initial_weights<float>(2);
    std::vector<float> table_m = std::vector<float>(table.size()), table_v = table_m;
    std::vector<float> weights_m = std::vector<float>(weights.size()), weights_v = weights_m;
};

// 1. The pixel centres of a picture of size x size pixels, as points of the cube.
std::vector<vec3<float>> pixel_centers(int size) {
    std::vector<vec3<float>> points;
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x)
            points.push_back({(static_cast<float>(x) + 0.5f) / static_cast<float>(size),
                              (static_cast<float>(y) + 0.5f) / static_cast<float>(size), 0.5f});
    return points;
}

// 2. Training. The points do not change, so they are prepared once: a Query stores the table entries that they read.
void learn(Backend& backend, LearnedField& learned, const Image<float>& picture) {
    const std::vector<vec3<float>> points = pixel_centers(picture.width);
    Field::Query<Backend, float> query;
    learned.field.prepare(backend, points, query);

    Field::Cache<Backend, float> cache;
    std::vector<float> outputs(3 * points.size()), dL_doutputs(outputs.size());
    std::vector<float> dL_dtable(learned.table.size()), dL_dweights(learned.weights.size());
    const Adam adam;
    const std::size_t plane = points.size();
    for (int step = 1; step <= 300; ++step) {
        // 3. Forward, then the gradient of the squared error. Outputs are rows of RGB; pictures are planes.
        learned.field.forward(backend, learned.table, learned.weights, query, outputs, cache);
        double loss = 0;
        for (std::size_t i = 0; i < plane; ++i)
            for (std::size_t c = 0; c < 3; ++c) {
                const float difference = outputs[3 * i + c] - picture.data[c * plane + i];
                dL_doutputs[3 * i + c] = 2 * difference / static_cast<float>(outputs.size());
                loss += difference * difference / static_cast<double>(outputs.size());
            }

        // 4. Backward adds to both gradients, and Adam zeroes them after use. In the table, Adam updates only the
        //    entries that at least one point reads: the gradients of the others are always zero.
        learned.field.backward(backend, learned.weights, query, dL_doutputs, cache, dL_dtable, dL_dweights);
        const double rate = step <= 200 ? 1e-2 : 2e-3;
        adam.step_rows(backend, Span<float>(learned.table), dL_dtable, learned.table_m, learned.table_v, query.touched,
                       Field::Grid::feature_count, rate, step, UsedGradients::zero);
        adam.step(backend, Span<float>(learned.weights), dL_dweights, learned.weights_m, learned.weights_v, rate, step,
                  UsedGradients::zero);
        if (step % 50 == 0) std::printf("step %3d: PSNR %.1f dB\n", step, psnr_of_mse(loss));
    }
}

// 5. A field has no pixels, so it can be evaluated at any resolution.
Image<float> paint(Backend& backend, const LearnedField& learned, int size) {
    const std::vector<vec3<float>> points = pixel_centers(size);
    Field::Query<Backend, float> query;
    learned.field.prepare(backend, points, query);
    Field::Cache<Backend, float> cache;
    std::vector<float> outputs(3 * points.size());
    learned.field.forward(backend, learned.table, learned.weights, query, outputs, cache);
    Image<float> picture(3, size, size);
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t c = 0; c < 3; ++c) picture.data[c * points.size() + i] = outputs[3 * i + c];
    return picture;
}

void story(const std::filesystem::path& folder) {
    constexpr int size = 128;
    Backend backend;
    LearnedField learned;
    const Image<float> lesson = examples::landscape_picture(size);
    learn(backend, learned, lesson);

    // 6. Evaluation on the training points, and at three times the resolution, where eight of nine pixels are new.
    const Image<float> truth = examples::landscape_picture(3 * size), painted = paint(backend, learned, 3 * size);
    const double known = psnr(paint(backend, learned, size).view(), lesson.view());
    const double between = psnr(painted.view(), truth.view());
    std::printf("PSNR %.1f dB on the training points, %.1f dB with the points in between; %zu numbers in the field\n",
                known, between, learned.table.size() + learned.weights.size());
    write_png(folder / "02_hash_grid_image.png", examples::beside<float>({&truth, &painted}));
    examples::claim(known > 35, "on the training points the PSNR is above 35 dB");
    examples::claim(between > 30, "with the points in between the PSNR is above 30 dB");
}

} // namespace

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
