// SPDX-License-Identifier: Apache-2.0
/// @file  What the programs run on a backend: on one whose buffers the host cannot access, every number is that of the
///        CPU's threads. The programs themselves run on threads here.
#include "programs/small_capture.hpp"
#include "support/guarded.hpp"

#include "common/machine.hpp"
#include "reconstruct/load_input.hpp"
#include "reconstruct/reconstruction.hpp"
#include "reconstruct/static_reconstruction.hpp"
#include "reconstruct/training.hpp"
#include "show/renderer.hpp"
#include "show/renderer_on.hpp"

#include <gsh/io/file/archive.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/model/checkpoint.hpp>
#include <gsh/reconstruct/reconstruction.hpp>
#include <gsh/reconstruct/static_reconstruction.hpp>
#include <gsh/reconstruct/train.hpp>
#include <gsh/reconstruct/training_record.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace backends_of_programs { // joined builds: other tests have helpers of the same names

using namespace gsh;
using namespace gsh::programs;
using test::Guarded;

namespace {

/// The small capture as the input of a reconstruction. With two people, the second one stands beside the first, where
/// no photograph shows a person.
ReconstructionInput input_of_people(std::size_t count) {
    const test::SmallCapture& s = test::studio();
    ReconstructionInput input;
    input.bodies = {s.body};
    input.capture = s.capture;
    for (std::size_t p = 0; p < count; ++p) {
        input.people.push_back({"person" + std::to_string(p), 0, s.capture.motion});
        for (auto& transl : input.people[p].motion.transl) transl.x += 0.6 * static_cast<double>(p);
    }
    return input;
}

ReconstructOptions options_of_test(const char* config, std::vector<std::string> more = {}) {
    ReconstructOptions o;
    o.config = config;
    o.set = {"hash.table_size=512", "ao.table_size=512", "light.points=1", "light.directions=2"};
    o.set.insert(o.set.end(), more.begin(), more.end());
    o.gaussians = 200;
    o.steps = 4;
    o.machine.threads = 2;
    return o;
}

/// Steps as in train(), without progress and checkpoints.
void train_to(AnyReconstruction& reconstruction, std::uint64_t steps) {
    while (reconstruction.step_count() < steps) {
        reconstruction.step(static_cast<double>(reconstruction.step_count()) / 8);
        reconstruction.settle();
    }
}

void check_equal(const AvatarData& a, const AvatarData& b) {
    CHECK(a.gaussians.means == b.gaussians.means);
    CHECK(a.gaussians.sh == b.gaussians.sh);
    CHECK(a.gaussians.log_scales == b.gaussians.log_scales);
    CHECK(a.gaussians.opacity_logits == b.gaussians.opacity_logits);
    CHECK(a.rig.joints == b.rig.joints);
    CHECK(a.ao == b.ao);
    CHECK(a.mean_irradiance == b.mean_irradiance);
    CHECK(a.light.has_value() == b.light.has_value());
    if (a.light && b.light) CHECK(a.light->log_intensities == b.light->log_intensities);
}

void check_equal(AnyReconstruction& a, AnyReconstruction& b) {
    CHECK(a.step_count() == b.step_count());
    const std::vector<StepValues> values_of_a = a.history(), values_of_b = b.history();
    REQUIRE(!values_of_a.empty());
    REQUIRE(!values_of_b.empty());
    CHECK(values_of_a.back().step == values_of_b.back().step);
    CHECK(values_of_a.back().loss == values_of_b.back().loss);
    CHECK(values_of_a.back().psnr == values_of_b.back().psnr);
    const std::vector<AvatarData> of_a = a.avatars(), of_b = b.avatars();
    REQUIRE(of_a.size() == of_b.size());
    for (std::size_t p = 0; p < of_a.size(); ++p) check_equal(of_a[p], of_b[p]);
    const Photo& photo = a.setup.test_photos[1];
    CHECK(a.compare(photo).render.data == b.compare(photo).render.data);
    const TableCounts in_a = a.table_counts(), in_b = b.table_counts();
    CHECK(in_a.lookups == in_b.lookups);
    CHECK(in_a.entries == in_b.entries);
    CHECK(in_a.touched == in_b.touched);
    CHECK(in_a.ao_touched == in_b.ao_touched);
}

} // namespace

TEST_CASE("a reconstruction is the same on another backend, and either continues the other's checkpoint") {
    const ReconstructionInput input = input_of_people(2);
    ReconstructOptions o = options_of_test("light", {"ao=pose", "ao.start=0.1", "refine.test_steps=2"});
    o.refine = o.refine_cameras = true;
    Machine machine(o.machine);
    const auto setup = [&] { return make_setup(machine, input, recipe_of(o, configuration_of(o))); };
    const auto threads = make_reconstruction(machine, setup());
    Guarded backend;
    Reconstruction<Guarded> guarded(backend, setup());
    train_to(*threads, 3);
    train_to(guarded, 3);
    check_equal(*threads, guarded);

    const test::Temporary folder;
    for (AnyReconstruction* from : {threads.get(), static_cast<AnyReconstruction*>(&guarded)}) {
        ArchiveWriter file(folder / "checkpoint.gsh", "checkpoint", checkpoint_version);
        from->save(file);
        file.commit();
        const ArchiveReader stored(folder / "checkpoint.gsh", "checkpoint", checkpoint_version);
        AnyReconstruction& to = from == &guarded ? *threads : guarded;
        to.load(stored);
        train_to(*from, from->step_count() + 1);
        train_to(to, from->step_count());
        check_equal(*from, to);
    }

    for (AnyReconstruction* each : {threads.get(), static_cast<AnyReconstruction*>(&guarded)}) {
        const Photo& photo = each->setup.test_photos[0];
        const Image<float> before = each->compare(photo).render;
        REQUIRE(each->refine_test_poses());
        CHECK(each->compare(photo).render.data != before.data);
        each->end_test_refinement();
        CHECK(each->compare(photo).render.data == before.data);
    }
    for (std::size_t p = 0; p < 2; ++p) {
        const Motion a = threads->refined_motion(p), b = guarded.refined_motion(p);
        CHECK(a.pose == b.pose);
        CHECK(a.transl == b.transl);
    }
}

TEST_CASE("so is a static scene") {
    const StaticPhotos input = static_photos_of(test::studio().capture, 0);
    ReconstructOptions o = options_of_test("static");
    o.set = {"density.start=2", "density.interval=3", "density.gradient_threshold=1e-6"};
    o.steps = 12;
    o.gaussians = 2000;
    Machine machine(o.machine);
    StaticRecipe recipe = static_recipe(o);
    recipe.points = 300;
    const auto threads = make_static_reconstruction(machine, input, recipe);
    Guarded backend;
    StaticReconstruction<Guarded> guarded(backend, input, recipe);
    for (AnyStaticReconstruction* each : {threads.get(), static_cast<AnyStaticReconstruction*>(&guarded)}) {
        TrainingRecord record;
        train(*each, recipe.length(), record);
    }
    CHECK(threads->step_count() == 12);
    CHECK(guarded.step_count() == 12);
    CHECK(threads->size() != 300);
    CHECK(threads->size() == guarded.size());
    CHECK(threads->total_change().split == guarded.total_change().split);
    CHECK(threads->cloud().means == guarded.cloud().means);
    CHECK(threads->compare(input.test[0]).render.data == guarded.compare(input.test[0]).render.data);
}

TEST_CASE("so are pictures of avatars and of scenes") {
    const ReconstructionInput input = input_of_people(2);
    const ReconstructOptions o = options_of_test("light");
    Machine machine(o.machine);
    const auto reconstruction =
        make_reconstruction(machine, make_setup(machine, input, recipe_of(o, configuration_of(o))));
    const std::vector<AvatarData> avatars = reconstruction->avatars();
    const test::Temporary folder;
    std::vector<std::filesystem::path> files, poses;
    for (std::size_t p = 0; p < 2; ++p) {
        files.push_back(folder / ("avatar" + std::to_string(p) + ".gsh"));
        poses.push_back(folder / ("poses" + std::to_string(p) + ".npz"));
        save_avatar(files.back(), avatars[p]);
        save_motion(poses.back(), input.people[p].motion);
    }
    const ShownPeople people(files, poses);
    const Camera<double>& camera = input.capture.cameras[0].camera;
    const vec3<float> background(0.2f, 0.4f, 0.6f);
    Guarded backend;
    const auto expected = make_renderer(machine, people);
    PeopleRenderer<Guarded> found(backend, people);
    for (const std::size_t frame : {1, 0})
        CHECK(found.render(frame, camera, background).data == expected->render(frame, camera, background).data);
    const GaussianCloud<float> scene = shaded_cloud(avatars[0]);
    CHECK(CloudRenderer<Guarded>(backend, scene).render(0, camera, background).data ==
          make_renderer(machine, scene)->render(0, camera, background).data);
}

TEST_CASE("fields train in mixed precision on threads: close to fp32, but not with its bits") {
    const ReconstructionInput input = input_of_people(1);
    ReconstructOptions o = options_of_test("paper");
    std::vector<AvatarData> avatars;
    for (const char* precision : {"fp32", "mixed"}) {
        o.machine.precision = precision;
        Machine machine(o.machine);
        CHECK(machine.computed_on().precision == precision);
        const auto reconstruction =
            make_reconstruction(machine, make_setup(machine, input, recipe_of(o, configuration_of(o))));
        train_to(*reconstruction, 4);
        avatars.push_back(reconstruction->avatars()[0]);
    }
    const auto &single = avatars[0].gaussians.means, &mixed = avatars[1].gaussians.means;
    CHECK(single != mixed);
    REQUIRE(single.size() == mixed.size());
    double squares = 0; // first steps of Adam depend on signs alone, so that single points differ by more
    for (std::size_t i = 0; i < single.size(); ++i) squares += dot(single[i] - mixed[i], single[i] - mixed[i]);
    CHECK(std::sqrt(squares / static_cast<double>(single.size())) < 1e-3);
}

TEST_CASE("an error names the last checkpoint if there is one, also where a device is lost after training") {
    TrainingRecord record;
    const auto fail = [&] { naming_checkpoint(record, [] { throw DeviceError("gone"); }); };
    CHECK_THROWS_WITH_AS(fail(), "gone", DeviceError);
    record.saved = 30;
    CHECK_THROWS_WITH_AS(fail(), "gone (the checkpoint of step 30 is complete; the run can be resumed from it)", Error);
}

TEST_CASE("a backend that is not there is refused in one line, and nothing is written") {
    const test::SmallCapture& s = test::studio();
    const test::Temporary folder;
    const std::string out = folder / "out", none = folder / "none";
    const auto refuse = [&](std::vector<std::string> words, std::vector<std::string> more, auto... said) {
        words.insert(words.end(), more.begin(), more.end());
        test::check_refused(test::run(words), words[0], {said...});
        CHECK(!std::filesystem::exists(out));
    };
    const std::vector<std::vector<std::string>> programs{
        s.reconstruct(out, {"--steps", "1"}),
        {"gsh-reconstruct", "--config", "static", "--capture", s.path, "--out", out},
        {"gsh-evaluate", "--capture", s.path, "--body", s.body_file, "--configs", "paper", "--out", out},
        {"gsh-render", none + ".ply", "--camera", s.camera, "--out", out},
        {"gsh-animate", none + ".gsh", "--poses", s.dance, "--out", out}};
    for (const std::vector<std::string>& words : programs) {
        refuse(words, {"--backend", "gpu"}, "--backend", "gpu", "threads", "cuda");
        refuse(words, {"--backend", "cuda", "--device", "-1"}, "--device", "-1");
        refuse(words, {"--device", "0"}, "--device needs --backend cuda");
        refuse(words, {"--precision", "half"}, "--precision", "half");
        if (words[1] == "--config") refuse(words, {"--precision", "mixed"}, "--config static has no --precision mixed");
        refuse(words, {"--backend", "threads", "--device", "0"}, "--device needs --backend cuda");
#if defined(GSH_PROGRAMS_WITH_CUDA)
        refuse(words, {"--backend", "cuda", "--device", "4096"}, "gsh::cuda::Device");
#else
        refuse(words, {"--backend", "cuda"}, "--backend cuda", "built without CUDA", "GSH_PROGRAMS_CUDA");
#endif
    }
    for (const char* backend : {"threads", "cuda", ""})
        refuse({"gsh-check", s.path, "--body", s.body_file, "--out", out}, {"--backend", backend},
               "gsh-check computes on the CPU alone");
}

} // namespace backends_of_programs
