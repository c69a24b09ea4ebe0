"""Names that are fetched, against a hub on the loopback interface."""

import hashlib
import json
import shutil
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote, urlsplit

import pytest
from huggingface_hub import constants

from cnca import build
from cnca.core.errors import DetectorError, GeneratorError
from cnca.core.hub import fetched_file, hub_folder
from cnca.detect import BUILTINS, detector_files, load_detector

COMMIT = "0123456789abcdef0123456789abcdef01234567"
NAME = "owner/tiny-detr"


class Hub(BaseHTTPRequestHandler):
    """What ``huggingface_hub`` asks a hub for: the list of files, and each of them."""

    folder, asked = None, []

    def do_HEAD(self):
        self._answer(with_body=False)

    def do_GET(self):
        self._answer(with_body=True)

    def _answer(self, *, with_body):
        path = unquote(urlsplit(self.path).path)
        self.asked.append(path)
        if path.startswith(f"/api/models/{NAME}/tree"):
            names = sorted(p.name for p in self.folder.iterdir())
            files = [{"type": "file", "path": n, **self._described(n)} for n in names]
            return self._send(json.dumps(files).encode(), with_body)
        if path.startswith(f"/api/models/{NAME}"):
            files = [{"rfilename": p.name} for p in sorted(self.folder.iterdir())]
            answer = {"id": NAME, "sha": COMMIT, "siblings": files}
            return self._send(json.dumps(answer).encode(), with_body)
        file = self.folder / path.rpartition("/")[2]
        if f"/{NAME}/resolve/" in path and file.is_file():
            return self._send(file.read_bytes(), with_body)
        self.send_response(404)
        self.send_header("X-Error-Code", "RepoNotFound")
        self.send_header("Content-Length", "0")
        return self.end_headers()

    def _described(self, name):
        content = (self.folder / name).read_bytes()
        return {"size": len(content), "oid": hashlib.sha1(content).hexdigest()}

    def _send(self, content, with_body):
        self.send_response(200)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("ETag", f'"{hashlib.sha1(content).hexdigest()}"')
        self.send_header("X-Repo-Commit", COMMIT)
        self.end_headers()
        if with_body:
            self.wfile.write(content)

    def log_message(self, *arguments):
        pass


@pytest.fixture
def hub(tmp_path, monkeypatch):
    """A hub with one model, and an empty cache."""
    shutil.copytree(BUILTINS["builtin:transformer"], tmp_path / "model")
    Hub.folder, Hub.asked = tmp_path / "model", []
    (Hub.folder / "README.md").write_text("---\nlicense: apache-2.0\n---\n")
    (Hub.folder / "pytorch_model.bin").write_bytes(b"could run code")
    server = ThreadingHTTPServer(("127.0.0.1", 0), Hub)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}"
    monkeypatch.setattr(constants, "ENDPOINT", address)
    monkeypatch.setattr(
        constants,
        "HUGGINGFACE_CO_URL_TEMPLATE",
        address + "/{repo_id}/resolve/{revision}/{filename}",
    )
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", False)
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    yield address
    server.shutdown()
    server.server_close()


def test_fetched_once_and_then_read_without_a_network(hub, capfd, monkeypatch):
    detector = load_detector(f"hf:{NAME}")
    assert detector.name == "tiny-detr"
    assert detector.class_names == ("car",)
    said = capfd.readouterr().err
    assert "license: apache-2.0" in said
    (folder,) = detector_files(f"hf:{NAME}")
    assert not (folder / "pytorch_model.bin").exists()
    count = len(Hub.asked)
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    assert load_detector(f"hf:{NAME}").differentiable
    assert len(Hub.asked) == count
    assert capfd.readouterr().err == ""


def test_offline_before_anything_is_there(hub, monkeypatch):
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    with pytest.raises(DetectorError, match="not in the cache, and HF_HUB_OFFLINE forbids"):
        load_detector(f"hf:{NAME}")
    assert Hub.asked == []


def test_no_network(hub, monkeypatch):
    closed = "http://127.0.0.1:9"
    monkeypatch.setattr(constants, "ENDPOINT", closed)
    with pytest.raises(DetectorError, match=r"'hf:owner/tiny-detr': cannot be fetched .*network\?"):
        load_detector(f"hf:{NAME}")


def test_what_the_hub_has_not(hub):
    with pytest.raises(GeneratorError, match="the hub has no such model, or it is private"):
        build.generator_files("hf:owner/nothing")
    with pytest.raises(DetectorError, match="write hf:OWNER/NAME"):
        load_detector("hf:a/b/c")


def test_weights_that_could_run_code_are_not_taken(hub):
    (Hub.folder / "model.safetensors").unlink()
    with pytest.raises(DetectorError, match="has no safetensors weights"):
        hub_folder(f"hf:{NAME}", ["*.json", "*.safetensors"], DetectorError)


def test_a_file_by_its_address_and_hash(hub):
    content = (Hub.folder / "config.json").read_bytes()
    address = f"{hub}/{NAME}/resolve/main/config.json"
    right = hashlib.sha256(content).hexdigest()
    with pytest.raises(DetectorError, match=f"has SHA-256 {right}, expected 00"):
        fetched_file("darknet:x", address, "00", DetectorError, license_name="MIT")
    path = fetched_file("darknet:x", address, right, DetectorError, license_name="MIT")
    assert path.read_bytes() == content
    count = len(Hub.asked)
    assert fetched_file("darknet:x", address, right, DetectorError, license_name="MIT") == path
    assert len(Hub.asked) == count


def test_names_that_are_no_downloads():
    with pytest.raises(DetectorError, match="there is darknet:yolov3, .*did you mean 'yolov3'"):
        load_detector("darknet:yolov33")
    with pytest.raises(DetectorError, match=r"yolo export model=runs/best\.pt format=onnx"):
        load_detector("runs/best.pt")
