// The picture of the robot's camera in the view's place: an MJPEG stream, or WebRTC that a WHEP address offers.
import type { Point } from "../ride/model";
import { element } from "../shared/dom";

/** ms until a lost picture is asked for again. */
const RETRY = 2000;
/** ms in which this browser's own addresses are found, before the other side is asked. */
const FOUND = 1000;
/** Begins the address of a camera that speaks WHEP. */
const WHEP = "whep+";
const NAME = "Picture of the robot’s camera";

export class Camera {
  readonly root: HTMLImageElement | HTMLVideoElement;

  /** Tells by `lost` whether the picture is lost; it is then asked for again. */
  constructor(
    address: string,
    private readonly lost: (is: boolean) => void,
  ) {
    this.root = address.startsWith(WHEP) ? this.called(address.slice(WHEP.length)) : this.streamed(address);
  }

  /** Fits the picture to the camera's field of view, given as shares of the view; without, it fills the view. */
  frame(shares: Point | null): void {
    const [wide, tall] = shares ?? [1, 1];
    this.root.style.inset = `${String(50 - 50 * tall)}% ${String(50 - 50 * wide)}%`;
    this.root.style.width = `${String(100 * wide)}%`;
    this.root.style.height = `${String(100 * tall)}%`;
    this.root.style.objectFit = shares === null ? "" : "fill";
  }

  private streamed(address: string): HTMLImageElement {
    const picture = element("img");
    picture.alt = NAME;
    picture.addEventListener("load", () => { this.lost(false); });
    picture.addEventListener("error", () => {
      this.lost(true);
      setTimeout(() => { picture.src = address; }, RETRY);
    });
    picture.src = address;
    return picture;
  }

  private called(address: string): HTMLVideoElement {
    const picture = element("video");
    picture.setAttribute("aria-label", NAME);
    picture.muted = picture.autoplay = picture.playsInline = true;
    picture.addEventListener("playing", () => { this.lost(false); });
    void this.call(address, picture);
    return picture;
  }

  /** Asks for the video; once it is lost, asks again. */
  private async call(address: string, picture: HTMLVideoElement): Promise<void> {
    if (typeof RTCPeerConnection === "undefined") {
      this.lost(true);
      return;
    }
    const peer = new RTCPeerConnection();
    let [session, over] = ["", false];
    const leave = (): void => {
      if (session !== "") void fetch(session, { method: "DELETE", keepalive: true });
      session = "";
    };
    const again = (): void => {
      if (over) return;
      over = true;
      removeEventListener("pagehide", leave);
      leave();
      peer.close();
      this.lost(true);
      setTimeout(() => { void this.call(address, picture); }, RETRY);
    };
    peer.addTransceiver("video", { direction: "recvonly" });
    peer.addEventListener("track", ({ track }) => {
      picture.srcObject = new MediaStream([track]);
      track.addEventListener("mute", () => { this.lost(true); });
      track.addEventListener("unmute", () => { this.lost(false); });
      track.addEventListener("ended", again);
    });
    peer.addEventListener("connectionstatechange", () => {
      if (peer.connectionState === "failed" || peer.connectionState === "closed") again();
    });
    addEventListener("pagehide", leave, { once: true });
    try {
      await peer.setLocalDescription();
      await found(peer);
      const headers = { "Content-Type": "application/sdp" };
      const answer = await fetch(address, { method: "POST", headers, body: peer.localDescription!.sdp });
      if (!answer.ok) throw new Error(String(answer.status));
      const place = answer.headers.get("Location");
      if (place !== null) session = new URL(place, address).href;
      await peer.setRemoteDescription({ type: "answer", sdp: await answer.text() });
    } catch {
      again();
    }
  }
}

/** Waits until a connection knows this browser's own addresses, at most for a while. */
function found(peer: RTCPeerConnection): Promise<void> {
  return new Promise((done) => {
    setTimeout(done, FOUND);
    const look = (): void => { if (peer.iceGatheringState === "complete") done(); };
    peer.addEventListener("icegatheringstatechange", look);
    look();
  });
}
