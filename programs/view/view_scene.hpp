// SPDX-License-Identifier: Apache-2.0
/// @file  What gsh-view shows: avatars with their motions, or a static scene, and the description that the page loads.
#pragma once

#include "common/rig_option.hpp"
#include "show/shown_people.hpp"
#include "view/view_request.hpp"

#include <gsh/body/motion.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh::programs {

struct LightOption;

/// A motion that the page can play.
struct ViewMotion {
    std::string name;
    Motion motion;
};

/// The middle and half the size of what is shown, in metres.
struct ViewBox {
    vec3<double> centre{0}, half{1};
};

/// The scene of a page. Either people, or a static scene of Gaussians.
struct ViewScene {
    std::vector<std::string> names; ///< of the files (names_of_files)
    std::optional<ShownPeople> people;
    std::vector<std::vector<ViewMotion>> motions; ///< of each person
    GaussianCloud<float> cloud;                   ///< if there are no people
    bool y_down = false;                          ///< by custom: the scene stands upright when y points down
    PixelFilter filter;
    ViewBox box;
    RigOption rig;              ///< how motions of other rigs are read, also those that the page sends
    int size = 540;             ///< pixels: the side of the page's picture at first
    bool adapts_detail = false; ///< pictures that show people whole and small have fewer Gaussians

    [[nodiscard]] std::vector<PersonSize> sizes() const;
    /// The vertical axis about which a person's light turns goes through this point.
    [[nodiscard]] vec3<double> light_centre(std::size_t person) const;
};

/// Reads what gsh-view is given: one or several avatars, or one scene, whose vertical `input_up` may name. With one
/// avatar, every file of poses is one of its motions; with several, there is one for each, in the same order. Without
/// poses, avatars with SMPL-X's joints have the motions of the built-in actor, and others stand in the canonical pose.
///
/// Frame   bodies are turned upright, as by gsh-animate. Later motions of an avatar begin where its first one begins,
///         on the same ground (place_like).
/// Errors  those of the files; ValueError for scenes and avatars together, and for other numbers of poses.
[[nodiscard]] ViewScene load_view_scene(const std::vector<std::filesystem::path>& files,
                                        const std::vector<std::filesystem::path>& poses, const LightOption& light,
                                        const RigOption& rig, std::vector<std::string>& warnings,
                                        const std::string& input_up = {});

/// Moves a motion so that its first frame has the place and the ground of another motion's.
void place_like(const RigData& rig, const Motion& other, Motion& motion);

/// Reads a motion that the page sent as the bytes of a file. Only the ending of `name` is used, to recognise the
/// layout. The motion is upright and placed like the person's first one. `input_fps` is the rate that the page states;
/// 0: none.
/// Errors  those of load_any_motion, with `name` for the file, in words for the page (page_error).
[[nodiscard]] ViewMotion read_sent_motion(const ViewScene& scene, std::size_t person, const std::string& name,
                                          const std::string& bytes, std::vector<std::string>& warnings,
                                          double input_fps = 0);

/// The description that the page loads, as JSON: names, skeletons, sizes, motions, the box, the filter.
[[nodiscard]] std::string describe(const ViewScene& scene);

} // namespace gsh::programs
