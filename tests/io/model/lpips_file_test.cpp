// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/model/lpips_file.hpp>

#include <gsh/io/file/npz_writer.hpp>

#include "io/safetensors_files.hpp"
#include "io/temporary.hpp"
#include "loss/lpips_networks.hpp"

#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using test::check_throws;

namespace {

using Values = std::vector<float>;

/// The spelling of names in a file.
struct Spelling {
    std::string backbone; ///< "features.", or "slice" followed by the slice's number
    std::string lin_before, lin_after;
};
const Spelling torchvision{"features.", "lin", ".model.1.weight"};
const Spelling lpips_package{"net.slice", "lin", ".model.1.weight"};
const Spelling wrapped{"metric.net.slice", "metric.lins.", ".model.1.weight"};
const Spelling bare{"features.", "lin", ""};

using Add = std::function<void(const std::string& name, const Shape& shape, const Values& values)>;

/// Calls add for each tensor of the network.
void for_tensors(const LpipsNetwork& network, const Spelling& spelling, const Add& add) {
    std::size_t convolution = 0, slice = 0, inputs = 3;
    for (const LpipsStep& step : network.steps) {
        if (step.is_convolution()) {
            const bool sliced = spelling.backbone.ends_with("slice");
            const std::string name = spelling.backbone + (sliced ? std::to_string(slice + 1) + "." : "") +
                                     std::to_string(step.number);
            const auto channels = std::size_t(step.channels), kernel = std::size_t(step.kernel);
            add(name + ".weight", {channels, inputs, kernel, kernel}, network.convolutions[convolution].weight);
            add(name + ".bias", {channels}, network.convolutions[convolution++].bias);
            inputs = channels;
        }
        if (step.compared) {
            const std::string name = spelling.lin_before + std::to_string(slice) + spelling.lin_after;
            add(name, spelling.lin_after.empty() ? Shape{inputs} : Shape{1, inputs, 1, 1}, network.lins[slice]);
            ++slice;
        }
    }
}

std::string list(const Shape& shape) {
    std::string text;
    for (const std::size_t length : shape) text += (text.empty() ? "" : ", ") + std::to_string(length);
    return text;
}

void write_safetensors(const std::filesystem::path& path, const LpipsNetwork& network, const Spelling& spelling,
                       const std::string& dtype = "F32") {
    test::SafetensorsFile file;
    for_tensors(network, spelling, [&](const std::string& name, const Shape& shape, const Values& values) {
        file.add(name, list(shape), values, dtype);
    });
    file.add("classifier.1.weight", "2, 2", std::vector<float>(4)); // not needed
    file.write(path);
}

void check_same(const LpipsNetwork& a, const LpipsNetwork& b, float tolerance = 0) {
    CHECK(a.name == b.name);
    REQUIRE(a.convolutions.size() == b.convolutions.size());
    REQUIRE(a.lins.size() == b.lins.size());
    const auto same = [&](const std::vector<float>& x, const std::vector<float>& y) {
        REQUIRE(x.size() == y.size());
        float worst = 0;
        for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, std::abs(x[i] - y[i]));
        CHECK(worst <= tolerance);
    };
    for (std::size_t k = 0; k < a.convolutions.size(); ++k) {
        same(a.convolutions[k].weight, b.convolutions[k].weight);
        same(a.convolutions[k].bias, b.convolutions[k].bias);
    }
    for (std::size_t k = 0; k < a.lins.size(); ++k) same(a.lins[k], b.lins[k]);
    CHECK_NOTHROW(validate(a, "test"));
}

const LpipsNetwork& alexnet() {
    static const LpipsNetwork network = test::with_noise(lpips_alexnet());
    return network;
}

} // namespace

TEST_CASE("weights under the names that people have") {
    const test::Temporary folder;
    for (const Spelling& spelling : {torchvision, lpips_package, wrapped, bare}) {
        CAPTURE(spelling.backbone);
        write_safetensors(folder / "a.safetensors", alexnet(), spelling);
        check_same(read_lpips(folder / "a.safetensors"), alexnet());
    }
}

TEST_CASE("weights in half precision") {
    const test::Temporary folder;
    write_safetensors(folder / "a.safetensors", alexnet(), torchvision, "F16");
    check_same(read_lpips(folder / "a.safetensors"), alexnet(), 1e-3f);
    write_safetensors(folder / "a.safetensors", alexnet(), torchvision, "BF16");
    check_same(read_lpips(folder / "a.safetensors"), alexnet(), 8e-3f);
}

TEST_CASE("weights in an npz archive") {
    const test::Temporary folder;
    NpzWriter file(folder / "a.npz");
    for_tensors(alexnet(), torchvision, [&](const std::string& name, const Shape& shape, const Values& values) {
        file.add(name, values, shape);
    });
    file.commit();
    check_same(read_lpips(folder / "a.npz"), alexnet());
}

TEST_CASE("VGG16 is known by its first convolution") {
    const test::Temporary folder;
    LpipsNetwork vgg = lpips_vgg16();
    CHECK(vgg.steps.back().number == 28);
    CHECK(vgg.steps[2].number == 4); // the first pooling
    vgg = test::with_noise(std::move(vgg));
    write_safetensors(folder / "a.safetensors", vgg, lpips_package, "BF16");
    check_same(read_lpips(folder / "a.safetensors"), vgg, 1e-2f);
}

TEST_CASE("files that are not LPIPS weights") {
    const test::Temporary folder;
    const auto path = folder / "a.safetensors";
    const auto write_without = [&](const std::string& left_out) {
        test::SafetensorsFile file;
        for_tensors(alexnet(), torchvision, [&](const std::string& name, const Shape& shape, const Values& values) {
            if (name != left_out) file.add(name, list(shape), values);
        });
        file.write(path);
    };
    const auto read = [&] { (void)read_lpips(path); };

    write_without("features.0.weight");
    check_throws<IoError>(read, {"features.0.weight or slice1.0.weight is missing", "the file holds", "lpips.md"});
    {
        test::SafetensorsFile file;
        file.add("a\x7F", list({2}), Values(2));
        file.write(path);
    }
    check_throws<IoError>(read, {"is missing; the file holds: a?; docs"});
    write_without("features.8.bias");
    check_throws<IoError>(read, {"features.8.bias"});
    write_without("lin4.model.1.weight");
    check_throws<IoError>(read, {"lin4.model.1.weight or lins.4.model.1.weight"});
    CHECK_THROWS_AS((void)read_lpips(folder / "nothing.safetensors"), IoError);
    CHECK_THROWS_AS((void)read_lpips(folder / "nothing.npz"), IoError);
    check_throws<IoError>([&] { (void)read_lpips(folder / "alex.pth"); }, {"PyTorch pickle", "lpips.md"});

    const auto write_changed = [&](const std::string& which, const std::string& shape, std::size_t count, float value) {
        test::SafetensorsFile file;
        for_tensors(alexnet(), torchvision, [&](const std::string& name, const Shape& own, const Values& values) {
            if (name == which) file.add(name, shape, std::vector<float>(count, value));
            else file.add(name, list(own), values);
        });
        file.write(path);
    };
    write_changed("features.0.weight", "64, 3, 7, 7", 64 * 3 * 49, 0);
    check_throws<ShapeError>(read, {"features.0.weight", "(64, 3, 7, 7)", "AlexNet", "VGG16"});
    write_changed("features.3.weight", "192, 64, 3, 3", 192 * 64 * 9, 0);
    check_throws<ShapeError>(read, {"features.3.weight", "(192, 64, 3, 3)", "(192, 64, 5, 5)"});
    write_changed("features.3.bias", "191", 191, 0);
    check_throws<ShapeError>(read, {"features.3.bias", "(191,)", "(192,)"});
    write_changed("lin1.model.1.weight", "1, 64, 1, 3", 192, 0);
    check_throws<ShapeError>(read, {"lin1.model.1.weight", "(1, 64, 1, 3)", "(1, 192, 1, 1)"});
    write_changed("lin1.model.1.weight", "1, 64, 1, 1", 64, 0);
    check_throws<ShapeError>(read, {"lin1.model.1.weight", "(1, 64, 1, 1)", "(1, 192, 1, 1)"});
    write_changed("lin1.model.1.weight", "1, 192, 1, 1", 192, std::nanf(""));
    check_throws<ValueError>(read, {"lin1.model.1.weight[0, 0, 0, 0] is NaN"});

    test::SafetensorsFile two; // two metrics in one file
    for (const char* owner : {"a.", "b."})
        for_tensors(alexnet(), torchvision, [&](const std::string& name, const Shape& shape, const Values& values) {
            two.add(owner + name, list(shape), values);
        });
    two.write(path);
    check_throws<IoError>(read, {"a.features.0.weight", "b.features.0.weight", "one network"});
}
