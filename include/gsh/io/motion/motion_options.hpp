// SPDX-License-Identifier: Apache-2.0
/// @file  Options of the readers of motions.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/io/motion/frame_rate.hpp>

#include <string>
#include <vector>

namespace gsh {

struct MotionFileOptions {
    /// Whether the model's mean hand is added to the file's hand poses.
    enum class Hands {
        automatic, ///< by the file's flat_hand (or flat_hand_mean); default: added to split files, not to whole ones
        add_mean,
        flat, ///< the file's numbers are the complete hand pose
    };
    Hands hands = Hands::automatic;
    double fps = 0; ///< frames a second of files that state neither timestamps nor a rate; 0: 30, with a warning

    /// The up direction. Poses that belong to cameras must remain as stored. Motions from elsewhere often have z up
    /// (AMASS) or lie in a camera's frame, y down.
    enum class World {
        as_stored,
        upright, ///< the coordinate axis that the body stands along becomes +y
    };
    World world = World::as_stored;
    double input_fps = 0; ///< frames a second, whatever the file states; 0: as the file states
    int person = 0;       ///< the motion to read if there are several people: an id, or an index in the list

    // For motions of other rigs, which are retargeted: BVH, glTF, SAM 3D Body.
    JointMap joint_map = {};        ///< which of the file's joints are which of the body's, beside known names
    std::vector<double> betas = {}; ///< the body's shape, which such files do not have; empty: the mean shape
    std::string animation = {};     ///< name of the animation, if a file has several; empty: the first

    [[nodiscard]] FrameRates rates() const { return {input_fps, fps}; }
};

} // namespace gsh
