// SPDX-License-Identifier: Apache-2.0
// The engine whose pictures gsh-view draws and sends.
"use strict";

gsh.ServerEngine = class {
  constructor(source, canvas) {
    this.name = "server";
    this.note = "";
    this.requests = 2; // at a time while a motion plays: the second is drawn while the first is sent
    this.source = source;
    this.asked = this.shown = 0; // numbers of pictures
    this.canvas = canvas;
    this.context = canvas.getContext("bitmaprenderer"); // shows a decoded image without copying it
  }
  async start() {} // the server has loaded everything

  /** Calls `received` when the server is free again. Resolves to whether the picture is on the canvas. */
  async draw(request, received) {
    const number = ++this.asked, bytes = await this.source.draw({ ...request, format: "jpeg" });
    received();
    const image = await createImageBitmap(bytes);
    if (number < this.shown) return false;
    this.shown = number;
    this.context.transferFromImageBitmap(image);
    return true;
  }

  /** The picture as a PNG, without loss. */
  async picture(request) { return this.source.draw({ ...request, format: "png" }); }
  stop() {}
};
