// SPDX-License-Identifier: Apache-2.0
#include "support/registered_source.hpp"

#include "support/figures.hpp"
#include "support/progress.hpp"

#include <gsh/body/joint_error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/train/registration.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

namespace {

/// Frames whose PSNR lies more than 6 dB below the median.
std::vector<std::size_t> doubtful_frames(const std::vector<double>& psnr) {
    std::vector<double> known;
    for (const double value : psnr)
        if (std::isfinite(value)) known.push_back(value);
    std::vector<std::size_t> frames;
    if (known.empty()) return frames;
    const auto middle = known.begin() + static_cast<std::ptrdiff_t>(known.size() / 2);
    std::nth_element(known.begin(), middle, known.end());
    for (std::size_t t = 0; t < psnr.size(); ++t)
        if (psnr[t] < *middle - 6) frames.push_back(t);
    return frames;
}

} // namespace

std::string RegistrationSummary::text() const {
    std::string result = "the registered bodies explain the photographs to " + fixed(psnr, 1) + " dB";
    for (const Moved& person : people)
        result += ", " + (people.size() > 1 ? person.name + ": " : std::string()) + "joints moved by " +
                  fixed(person.joints_mm, 0) + " mm (" + fixed(person.root_aligned_mm, 0) +
                  " mm relative to the root), the shape by " + fixed(person.betas, 2) + " per coefficient";
    return result;
}

void register_source(cpu::Threads& backend, Source& source, std::uint64_t seed) {
    std::vector<RegisteredPerson> people;
    for (std::size_t p = 0; p < source.people.size(); ++p) {
        people.push_back({&source.body(p), &source.people[p].motion});
        if (!source.body(p).faces.empty()) continue;
        source.warnings.push_back("the body of " + source.people[p].name +
                                  " has no triangles, so poses are not registered before training");
        return;
    }
    const std::vector<Photo> photos = photos_of(source.capture, false);
    Progress shown("registering poses");
    RegistrationParams params;
    params.progress = [&](double share) { shown.show(share, ""); };
    Registration found =
        register_motions(backend, Span<const RegisteredPerson>(people), Span<const Photo>(photos), seed, params);
    shown.show(1, "done");

    RegistrationSummary summary;
    summary.psnr = found.fits.back().psnr;
    summary.doubtful_frames = doubtful_frames(found.frame_psnr);
    summary.frame_psnr = std::move(found.frame_psnr);
    for (std::size_t p = 0; p < people.size(); ++p) {
        const BodyModel& body = *people[p].body;
        Motion& before = source.people[p].motion;
        Motion& after = found.motions[p];
        double squares = 0;
        for (std::size_t k = 0; k < after.betas.size(); ++k)
            squares += std::pow(after.betas[k] - (k < before.betas.size() ? before.betas[k] : 0), 2);
        const auto moved = [&](RootAlignment aligned) { return joint_errors(body, after, before, aligned).mean_mm; };
        summary.people.push_back({.name = source.people[p].name,
                                  .joints_mm = moved(RootAlignment::none),
                                  .root_aligned_mm = moved(RootAlignment::position),
                                  .betas = std::sqrt(squares / std::max(1.0, static_cast<double>(after.betas.size())))});
        before = std::move(after);
    }
    if (!summary.doubtful_frames.empty())
        source.warnings.push_back("frames " + frames_text(summary.doubtful_frames) +
                                  " fit more than 6 dB worse than the others after registration; look at their poses "
                                  "and masks, or leave them out");
    source.registration = std::move(summary);
}

} // namespace gsh::examples
